"""Forgeries of a run's recordings, with all checks made anew that need no key."""

from __future__ import annotations

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
Change: TypeAlias = Callable[[RecordedMessage], RecordedMessage | None]
Forge: TypeAlias = Callable[[Run], Run]


@dataclass(frozen=True)
class Forgery:
    """`found`: what must be said of it, as a regular expression; `by_others`: the same, if the
    forger has the key of the robot whose recording it is; None: nothing is found then.
    """

    forge: Forge
    found: str
    by_others: str | None = None


def in_file(name: str, change: Callable[[list[RecordedMessage]], list[RecordedMessage]]) -> Forge:
    """Other records in one file, or in all (`*`)."""

    def forge(run: Run) -> Run:
        return {
            file: replace(each, records=tuple(change(list(each.records))))
            if name in (file, "*")
            else each
            for file, each in run.items()
        }

    return forge


def without(topic: str, **having: Any) -> Callable[[list[RecordedMessage]], list[RecordedMessage]]:
    """Without the messages on a topic that have these values."""
    return lambda records: [r for r in records if not fits(r, topic, having)]


def fits(record: RecordedMessage, topic: str, having: Mapping[str, Any]) -> bool:
    return record.topic == topic and having.items() <= dict(record.data).items()


def first(
    topic: str, change: Change, **having: Any
) -> Callable[[list[RecordedMessage]], list[RecordedMessage]]:
    """With the first such message changed; None: dropped."""
    return lambda records: _changed(records, change, *_places(records, topic, having)[:1])


def last(
    topic: str, change: Change, **having: Any
) -> Callable[[list[RecordedMessage]], list[RecordedMessage]]:
    """With the last such message changed; None: dropped."""
    return lambda records: _changed(records, change, *_places(records, topic, having)[-1:])


def _places(records: list[RecordedMessage], topic: str, having: Mapping[str, Any]) -> list[int]:
    return [at for at, each in enumerate(records) if fits(each, topic, having)]


def _changed(records: list[RecordedMessage], change: Change, at: int) -> list[RecordedMessage]:
    changed = change(records[at])
    return [*records[:at], *([changed] if changed is not None else []), *records[at + 1 :]]


def with_data(**values: Any) -> Change:
    """The message with other values."""
    return lambda record: replace(record, data={**record.data, **values})


def at(later_us: int) -> Change:
    """The message at another time."""
    return lambda record: replace(record, at_us=record.at_us + later_us)


def dropped(_: RecordedMessage) -> None:
    """No message."""


def twice(topic: str, **having: Any) -> Callable[[list[RecordedMessage]], list[RecordedMessage]]:
    """With the first such message a second time."""

    def repeat(records: list[RecordedMessage]) -> list[RecordedMessage]:
        place = _places(records, topic, having)[0]
        return [*records[: place + 1], *records[place:]]

    return repeat


def without_last_plans(count: int) -> Callable[[list[RecordedMessage]], list[RecordedMessage]]:
    """Without the last plans, and the statuses that belong to them."""

    def remove(records: list[RecordedMessage]) -> list[RecordedMessage]:
        begin = _places(records, PLANS, {})[-count]
        rest = [each for each in records[begin:] if each.topic not in (PLANS, STATUSES)]
        return [*records[:begin], *rest]

    return remove


def lacking(name: str) -> Forge:
    """Without a file."""
    return lambda run: {file: each for file, each in run.items() if file != name}


def cut(share: float) -> Callable[[list[RecordedMessage]], list[RecordedMessage]]:
    """Without the end."""
    return lambda records: records[: int(len(records) * share)]


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
                data = encoder.sign(own, record.data["end"])
            writer.write(record.topic, record.at_us, data)
            encoder.encode(record.topic, record.at_us, data)
        if own is not None and not is_ended(each):
            last_us = each.records[-1].at_us
            writer.write(SIGNATURES, last_us, encoder.sign(own, True))
        writer.close()
        found.append(parse_recording(path.read_bytes(), path))
    return found


def is_ended(recording: Recording) -> bool:
    """Whether its last record is the signature of its end."""
    last = recording.records[-1]
    return last.topic == SIGNATURES and bool(last.data["end"])


def blamed(run: Run) -> Run:
    """A1's death is B2's, for the observer and one robot."""
    for file in ("run.mcap", "B1.mcap"):
        for topic in (FAULTS, ROBOTS):
            state = {"event": "dead"} if topic == FAULTS else {"state": "dead"}
            run = in_file(file, first(topic, with_data(robot="B2"), robot="A1", **state))(run)
    return run


TOLD = "is not what .* has told others that it signed"
SHORT = "A1.mcap.*: it ends at 3.*, and B2.mcap heard of its records until 11.5"
CUT = "it has no end, and no other recording says that"
B1 = "B1.mcap"
FORGERIES: dict[str, Forgery] = {
    "all actions of a robot removed": Forgery(
        in_file(B1, without(ACTIONS)), "B1.mcap: record", "and has not started it"
    ),
    "an end changed": Forgery(
        in_file(B1, first(ACTIONS, with_data(success=False), event="finished")),
        "B1.mcap: record",
        "and its outcome, record .*, differ",
    ),
    "a start removed": Forgery(
        in_file(B1, first(ACTIONS, dropped, event="started")),
        "B1.mcap: record",
        "and has not started it",
    ),
    "a start doubled": Forgery(
        in_file(B1, twice(ACTIONS, event="started")),
        "B1.mcap: record",
        "an action starts, and the end of .* is missing",
    ),
    "a robot's file removed": Forgery(lacking(B1), "B1: no recording of its life", "no recording"),
    "the observer's file removed": Forgery(
        lacking("run.mcap"), "no observer's recording is here", "no observer's recording is here"
    ),
    "the end of all files removed": Forgery(in_file("*", cut(0.7)), CUT, "has not recorded its"),
    "the end of one file removed": Forgery(
        in_file(B1, cut(0.7)), f"B1.mcap: {CUT}", "B1 has not recorded its"
    ),
    "the killed robot's file cut": Forgery(
        in_file("A1.mcap", cut(0.3)),
        SHORT,
        SHORT,
    ),
    "a detection time changed": Forgery(
        in_file("run.mcap", first(FAULTS, at(-900_000), event="dead")),
        "run.mcap: record",
        "A1 is dead here, and alive",
    ),
    "a death blamed on another robot": Forgery(
        blamed, "run.mcap: record", "A1 is not in the alive set, and is suspect"
    ),
    "the last plan removed": Forgery(
        in_file(B1, last(PLANS, dropped)),
        "B1.mcap: record",
        TOLD,
    ),
    "the last plans removed": Forgery(
        in_file(B1, without_last_plans(9)),
        "B1.mcap: record",
        "its last plan is not that of its last facts",
    ),
    "the end of the recorded life removed": Forgery(
        in_file(B1, last(LIFE, dropped)), "B1.mcap: record", None
    ),
    "an alive set changed": Forgery(
        in_file(B1, last(ALIVE, with_data(robots={"B1": "1.0"}))),
        "B1.mcap: record",
        "the plan's alive set is not the one recorded before it",
    ),
    "a fact removed": Forgery(
        in_file(B1, first(FACTS, dropped, author="B1")), "B1.mcap: record", "B1 has not recorded"
    ),
    "statuses changed": Forgery(
        in_file(B1, first(STATUSES, with_data(T_Li="failure"))), "B1.mcap: record", TOLD
    ),
    "times changed": Forgery(in_file(B1, first(FAULTS, at(1_000))), "B1.mcap: record", TOLD),
    "a position changed": Forgery(in_file(B1, first(POSITIONS, at(1))), "B1.mcap: record", TOLD),
    "signatures removed": Forgery(
        in_file("*", without(SIGNATURES)), "it has no signature of its owner", TOLD
    ),
}
