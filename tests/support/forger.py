"""Forgeries of a run's recordings, with all checks made anew that need no key."""

from __future__ import annotations

import random
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeAlias

from mrbt_mesh.core.membership.keys import Keys
from mrbt_mesh.recording.channels import (
    ACTIONS,
    ALIVE,
    FACTS,
    FAULTS,
    LIFE,
    PLANS,
    POSITIONS,
    ROBOTS,
    SIGNATURES,
    STATUSES,
)
from mrbt_mesh.recording.messages import MessageEncoder
from mrbt_mesh.recording.reader import RecordedMessage, Recording, parse_recording
from mrbt_mesh.recording.writer import RecordingWriter

Run: TypeAlias = dict[str, Recording]
Records: TypeAlias = list[RecordedMessage]
Change: TypeAlias = Callable[[RecordedMessage], RecordedMessage | None]


@dataclass(frozen=True)
class Cast:
    """The file that is forged, and what else a forgery is about: robots that died, and lived."""

    file: str
    dead: str
    other: str
    draw: random.Random

    def named(self, having: Mapping[str, Any], file: Recording) -> dict[str, Any]:
        """The values of the records that are meant."""
        names = {"OWN": file.metadata.robot, "DEAD": self.dead, "OTHER": self.other}
        return {key: names.get(value, value) for key, value in having.items()}


# Raises LookupError for a run in which there is nothing to be forged so.
Edit: TypeAlias = Callable[[Recording, Cast], Records]
Forge: TypeAlias = Callable[[Run, Cast], Run]


@dataclass(frozen=True)
class Forgery:
    """`found`: what must be said of it, as a regular expression; `by_others`: the same, if the
    forger has the key of the robot whose recording it is; None: nothing is found then.
    """

    forge: Forge
    found: str
    by_others: str | None = None


def in_file(edit: Edit, name: str = "") -> Forge:
    """Other records in the forged file, or in that of a name, or in all (`*`)."""

    def forge(run: Run, cast: Cast) -> Run:
        wanted = name or cast.file

        def forged(each: Recording) -> Recording:
            records: Any = tuple(edit(each, cast))  # in place of those of a file
            return replace(each, records=records)

        return {file: forged(each) if wanted in (file, "*") else each for file, each in run.items()}

    return forge


def _places(file: Recording, cast: Cast, topic: str, having: Mapping[str, Any]) -> list[int]:
    wanted = cast.named(having, file).items()
    return [
        at
        for at, each in enumerate(file.records)
        if each.topic == topic and wanted <= dict(each.data).items()
    ]


def without(topic: str) -> Edit:
    """Without the messages on a topic."""

    def edit(file: Recording, cast: Cast) -> Records:
        _places(file, cast, topic, {})[0]
        return [each for each in file.records if each.topic != topic]

    return edit


def some(topic: str, change: Change, **having: Any) -> Edit:
    """With one such message changed; None: dropped."""
    return _one(topic, change, having, lambda places, draw: draw.choice(places))


def last(topic: str, change: Change, **having: Any) -> Edit:
    """With the last such message changed; None: dropped."""
    return _one(topic, change, having, lambda places, _: places[-1])


def _one(
    topic: str,
    change: Change,
    having: Mapping[str, Any],
    choose: Callable[[list[int], random.Random], int],
) -> Edit:
    def edit(file: Recording, cast: Cast) -> Records:
        at, records = choose(_places(file, cast, topic, having), cast.draw), list(file.records)
        changed = change(records[at])
        records[at : at + 1] = [changed] if changed is not None else []
        return records

    return edit


def with_data(**values: Any) -> Change:
    """The message with other values."""
    return lambda record: replace(record, data={**record.data, **values})


def at(later_us: int) -> Change:
    """The message at another time."""
    return lambda record: replace(record, at_us=record.at_us + later_us)


def dropped(_: RecordedMessage) -> None:
    """No message."""


def twice(topic: str, **having: Any) -> Edit:
    """With one such message a second time."""

    def edit(file: Recording, cast: Cast) -> Records:
        place = cast.draw.choice(_places(file, cast, topic, having))
        return [*file.records[: place + 1], *file.records[place:]]

    return edit


def without_last_plans(count: int) -> Edit:
    """Without the last plans, and the statuses that belong to them."""

    def edit(file: Recording, cast: Cast) -> Records:
        begin = _places(file, cast, PLANS, {})[-count]
        rest = [each for each in file.records[begin:] if each.topic not in (PLANS, STATUSES)]
        return [*file.records[:begin], *rest]

    return edit


def behind_end(topic: str) -> Edit:
    """With the last such message once more, behind everything."""

    def edit(file: Recording, cast: Cast) -> Records:
        again = file.records[_places(file, cast, topic, {})[-1]]
        return [*file.records, replace(again, at_us=file.records[-1].at_us)]

    return edit


def lacking(name: str = "") -> Forge:
    """Without a file."""

    def forge(run: Run, cast: Cast) -> Run:
        run[name or cast.file]
        return {file: each for file, each in run.items() if file != (name or cast.file)}

    return forge


def cut(share: float) -> Edit:
    """Without the end."""
    return lambda file, _: list(file.records[: int(len(file.records) * share)])


def written_again(run: Run, folder: Path, keys: Mapping[str, Keys], true: Run) -> list[Recording]:
    """The files of a forger who has these keys, by the name of the file; those that are as in the
    `true` run stay as they are. He signs where they were signed, so that what is before his first
    change stays the same.
    """
    found = []
    for name, each in run.items():
        if each is true[name]:
            found.append(each)
            continue
        path = folder / name
        path.unlink(missing_ok=True)
        own = keys.get(name)
        encoder = MessageEncoder(each.metadata)
        writer = RecordingWriter(path, each.metadata, beats=True)
        for record in each.records:
            data = record.data
            if own is not None and record.topic == SIGNATURES:
                data = encoder.sign(own, record.data["end"], record.at_us)
            writer.write(record.topic, record.at_us, data)
            encoder.encode(record.topic, record.at_us, data)
        if own is not None and not is_ended(each):
            last_us = each.records[-1].at_us
            writer.write(SIGNATURES, last_us, encoder.sign(own, True, last_us))
        writer.close()
        found.append(parse_recording(path.read_bytes(), path))
    return found


def is_ended(recording: Recording) -> bool:
    """Whether its last record is the signature of its end."""
    last = recording.records[-1]
    return last.topic == SIGNATURES and bool(last.data["end"])


def blamed(run: Run, cast: Cast) -> Run:
    """A robot's death is that of another one, for the observer and one robot."""
    for file in ("run.mcap", cast.file):
        for topic in (FAULTS, ROBOTS):
            state = {"event": "dead"} if topic == FAULTS else {"state": "dead"}
            edit = some(topic, with_data(robot=cast.other), robot="DEAD", **state)
            run = in_file(edit, file)(run, cast)
    return run


def forged(name: str, run: Run, cast: Cast) -> Run | None:
    """The run with a forgery; None where it has nothing that could be forged so."""
    try:
        found = FORGERIES[name].forge(run, cast)
    except LookupError:
        return None
    is_same = all(
        file in found and found[file].records == each.records for file, each in run.items()
    )
    return None if is_same else found


def behind_signatures(run: Run, true: Run) -> bool:
    """Whether nothing is changed but what was never signed: the last moments of a killed robot."""
    return all(
        name in run and (run[name] is each or _signed(run[name]) == _signed(each))
        for name, each in true.items()
    )


def _signed(recording: Recording) -> tuple[RecordedMessage, ...]:
    """The records up to the last signature."""
    last = max((n for n, r in enumerate(recording.records) if r.topic == SIGNATURES), default=-1)
    return recording.records[: last + 1]


TOLD = "is not what .* has told others that it signed"
SHORT = "B1.mcap.*: it ends at .*, and .*.mcap heard of its records until"
CUT = "it ends abruptly at"
RECORD = "B1.mcap: record"
FORGERIES: dict[str, Forgery] = {
    "all actions of a robot removed": Forgery(
        in_file(without(ACTIONS)), RECORD, "and has not started it"
    ),
    "an end changed": Forgery(
        in_file(some(ACTIONS, with_data(success=False), event="finished")),
        RECORD,
        "and its outcome, record .*, differ",
    ),
    "a start removed": Forgery(
        in_file(some(ACTIONS, dropped, event="started")), RECORD, "and has not started it"
    ),
    "a start doubled": Forgery(
        in_file(twice(ACTIONS, event="started")),
        RECORD,
        "an action starts, and the end of .* is missing",
    ),
    "a message behind the signed end": Forgery(
        in_file(behind_end(LIFE)), "added behind its signed end", "added behind its signed end"
    ),
    "a robot's file removed": Forgery(lacking(), "B1: no recording of its life", "no recording"),
    "the observer's file removed": Forgery(
        lacking("run.mcap"), "no observer's recording is here", "no observer's recording is here"
    ),
    "the end of all files removed": Forgery(in_file(cut(0.7), "*"), CUT, "has not recorded its"),
    "the end of one file removed": Forgery(
        in_file(cut(0.7)), f"B1.mcap: {CUT}", "B1 has not recorded its"
    ),
    "most of a file removed": Forgery(in_file(cut(0.3)), SHORT, SHORT),
    "a death at another time": Forgery(
        in_file(some(FAULTS, at(-900_000), event="dead")), RECORD, "its time is before that"
    ),
    "a death blamed on another robot": Forgery(
        blamed, "run.mcap: record", "A1 is not in the alive set, and is suspect"
    ),
    "the last plan removed": Forgery(in_file(last(PLANS, dropped)), RECORD, TOLD),
    "the last plans removed": Forgery(
        in_file(without_last_plans(9)), RECORD, "its last plan is not that of its last facts"
    ),
    "a plan removed": Forgery(in_file(some(PLANS, dropped)), RECORD, TOLD),
    "a plan for others": Forgery(
        in_file(some(PLANS, with_data(alive={}))), RECORD, "does not follow|alive set"
    ),
    "the end of the recorded life removed": Forgery(in_file(last(LIFE, dropped)), RECORD, None),
    "an alive set changed": Forgery(
        in_file(last(ALIVE, with_data(robots={"B1": "1.0"}))),
        RECORD,
        "the plan's alive set is not the one recorded before it",
    ),
    "a fact removed": Forgery(
        in_file(some(FACTS, dropped, author="OWN")), RECORD, "B1 has not recorded"
    ),
    "another robot's fact removed": Forgery(in_file(some(FACTS, dropped)), RECORD, TOLD),
    "a fact doubled": Forgery(in_file(twice(FACTS)), RECORD, "of facts where .* is due"),
    "a fact at another time": Forgery(in_file(some(FACTS, at(-1))), RECORD, TOLD),
    "statuses changed": Forgery(in_file(some(STATUSES, with_data(T_Li="failure"))), RECORD, TOLD),
    "times changed": Forgery(in_file(some(FAULTS, at(1_000))), RECORD, TOLD),
    "a position changed": Forgery(in_file(some(POSITIONS, at(1))), RECORD, TOLD),
    "signatures removed": Forgery(
        in_file(without(SIGNATURES)), "it has no signature of its owner", TOLD
    ),
    "signatures of all removed": Forgery(
        in_file(without(SIGNATURES), "*"), "it has no signature of its owner", TOLD
    ),
}
