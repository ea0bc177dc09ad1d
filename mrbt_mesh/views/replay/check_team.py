"""Checks what a team's recordings prove together: their owners, their completeness, their ends."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.core.membership.keys import Role
from mrbt_mesh.recording import channels
from mrbt_mesh.recording.folder import (
    FOLDER,
    OBSERVERS,
    first_part,
    name_of_owner,
    number_of_part,
)
from mrbt_mesh.recording.messages import read_incarnation
from mrbt_mesh.recording.metadata import NamedRecording
from mrbt_mesh.recording.reader import RecordedMessage, Recording, Signature
from mrbt_mesh.recording.writer import SIGN_US
from mrbt_mesh.runtime.launcher_lock import LEAVE_LIMIT_S
from mrbt_mesh.runtime.member_keys import Manifest, was_signed
from mrbt_mesh.runtime.run_dir import SUMMARY_FILE
from mrbt_mesh.views.replay.check_named import (
    check_named,
    finished_by,
    is_observers_of_run,
    misnamed,
)
from mrbt_mesh.views.replay.check_recording import RecordingCheck
from mrbt_mesh.views.replay.findings import End, Gap, GapKind, ProvedRecording, RecordingFinding

_WITHOUT = "start the team without --insecure (simulated runs have no keys)"
_ACCEPT_END = f"if nothing more was recorded, accept it with --accept {GapKind.END}"
_WITHOUT_KEYS = "give --keys, a folder with the team's manifest"
# The clocks of a team's computers may differ by this much.
CLOCKS_US = 5_000_000


@dataclass
class TeamCheck:
    """Checks recordings together. Call `run` once, after each recording was checked by itself.

    `finished`: which files say of which recordings that nobody wrote them any more. `is_run_dir`:
    they are those of a run directory, where one of them must say so of each without a signed end.
    `is_running`: the team is at work, so recordings that are still written have no end.
    """

    checks: Sequence[RecordingCheck]
    manifest: Manifest | None
    finished: Sequence[tuple[str, NamedRecording]] = ()
    is_run_dir: bool = False
    is_running: bool = False
    proved: list[ProvedRecording] = field(default_factory=list)
    gaps: list[Gap] = field(default_factory=list)
    findings: list[RecordingFinding] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    ends: dict[str, End] = field(default_factory=dict)

    def run(self) -> None:
        """Find what is proved, and what is not."""
        if self.manifest is None:
            has_keys = any(check.recording.metadata.has_keys for check in self.checks)
            remedy = _WITHOUT_KEYS if has_keys else _WITHOUT
            self._gap(GapKind.UNSIGNED, "all recordings", "no signature was checked", remedy)
        self._doubled()
        self._earlier()
        for check in self.checks:
            self._name(check)
            self._parts(check.recording)
            self._revoked(check)
            self._recording(check)
        metadata = [check.recording.metadata for check in self.checks]
        if all(each.robot for each in metadata) and any(each.is_observed for each in metadata):
            remedy = "give run.mcap, which what launched the robots has recorded"
            self._gap(GapKind.OBSERVER, "run.mcap", "no observer's recording is here", remedy)
        self._missing_lives()
        if self.manifest is not None:
            self._heads()

    def _gap(self, kind: GapKind, of: str, text: str, remedy: str) -> None:
        self.gaps.append(Gap(kind, of, text, remedy))

    def _name(self, check: RecordingCheck) -> None:
        """Check that a file in a run directory is named after the robot that recorded it.

        Elsewhere a file may have any name, and a note says whose it is.
        """
        robot, path = check.recording.metadata.robot, check.recording.path
        text = f"it is a recording of {robot or 'an observer'}"
        called = name_of_owner(path)
        is_robots_folder = path.parent.name == FOLDER
        is_observers = called == OBSERVERS and (path.parent / FOLDER).is_dir()
        if called != robot if is_robots_folder else robot and is_observers:
            check.add_to(0, text)
        elif is_observers_of_run(check.recording):
            if other := misnamed(check.recording):
                check.add_to(0, other)
        elif called != (robot or OBSERVERS):
            self.notes.append(f"{check.recording.name}: {text}")
        for each in check.recording.parts or (check.recording,):
            if number_of_part(each.path) != each.metadata.part:
                check.add_to(0, f"{each.name} is part {each.metadata.part}")

    def _doubled(self) -> None:
        """Check that no two files begin at the same time or have the same life: a process records
        once.
        """
        known: dict[tuple[str, object], RecordingCheck] = {}
        for check in self.checks:
            begun = check.recording.metadata.epoch_ns + check.recording.begin_us * 1_000
            for what in (begun, *lives(check.recording)):
                first = known.setdefault((check.robot, what), check)
                if first_part(first.recording.path) != first_part(check.recording.path):
                    text = f"what is in it was recorded in {first.recording.name}, too"
                    check.add_to(0, text)
                    break

    def _earlier(self) -> None:
        """Check the recordings that existed when others began.

        Each missing one is reported once.
        """
        recordings, known = [check.recording for check in self.checks], set[str]()
        for recording in recordings:
            for each in check_named(recording.name, recording.metadata.earlier, recordings):
                if isinstance(each, Gap):
                    if each.of not in known:
                        self.gaps.append(each)
                    known.add(each.of)
                else:
                    self.findings.append(each)

    def _parts(self, recording: Recording) -> None:
        """Report parts that were kept when the last part began, and are missing."""
        last = recording.parts[-1].metadata if recording.parts else recording.metadata
        if recording.metadata.part > last.kept_from:
            text = (
                f"part {last.kept_from} of it is missing: it was kept when part {last.part} began"
            )
            self._gap(GapKind.END, recording.name, text, "give all its parts")

    def _revoked(self, check: RecordingCheck) -> None:
        """Check revocations: only the manifest revokes a key.

        A member with a newer key was replaced.
        """
        members = self.manifest.members if self.manifest is not None else {}
        for each in check.recording.records.of(channels.REVOKED) if members else ():
            for robot in each.data["robots"]:
                member = members.get(robot)
                if member is not None and not member.is_revoked and not member.former:
                    check.add(each, f"the key of {robot} was not revoked")

    # -- one recording --------------------------------------------------------------------------

    def _recording(self, check: RecordingCheck) -> None:
        recording = check.recording
        if not recording.records:
            self.ends[recording.name] = self._end(recording)
            text = "it holds no record: its writer was ended at once"
            self._gap(GapKind.END, recording.name, _with_torn(text, recording), _ACCEPT_END)
            return
        last = self._last_signature(check)
        is_ended = recording.cut_off_at is None
        if self.manifest is not None:
            is_ended = last is not None and last.is_end
        self.ends[recording.name] = End.CLOSED if is_ended else self._end(recording)
        end = "its end" if is_ended else self._missing_end(recording, last)
        if is_ended and recording.torn:
            self.notes.append(f"{recording.name}: behind its signed end {recording.torn}")
        if self.manifest is None:
            return
        if last is None:
            text = "it has no signature of its owner"
            self._gap(GapKind.UNSIGNED, recording.name, text, "give the file as it was recorded")
        else:
            until_us = max(0, last.until_us - recording.begin_us)
            self.proved.append(ProvedRecording(recording.name, last.by, until_us, end))
            self._unsigned_end(recording, last)

    def _end(self, recording: Recording) -> End:
        """Return how a recording without an end ended: its robot may have died."""
        if not recording.is_finished:
            return End.WRITTEN
        life = _last_life(recording)
        has_died = life is not None and any(dead for *_, dead in self._deaths(recording, life))
        return End.KILLED if has_died else End.ABRUPT

    def _unsigned_end(self, recording: Recording, last: Signature) -> None:
        """Check what follows the last signature: a killed robot has recorded little after it."""
        end_us = recording.records[-1].at_us
        may_us = recording.metadata.timing.max_detection_us + SIGN_US
        if end_us > last.until_us + may_us:
            text = f"the last {(end_us - last.until_us) / 1e6:.1f} s of it are not signed"
            self._gap(GapKind.END, recording.name, text, "give the file as it was recorded")

    def _last_signature(self, check: RecordingCheck) -> Signature | None:
        """Return the owner's last signature; signatures by anyone else are findings."""
        if self.manifest is None:
            return None
        last = None
        for each in check.recording.signatures:
            check.counts["recording_signatures"] += 1
            if not self._is_owners(check.recording.metadata.robot, each):
                check.add_to(each.number, f"what was recorded before was not signed by {each.by}")
            else:
                last = each
        return last

    def _is_owners(self, robot: str, each: Signature) -> bool:
        assert self.manifest is not None
        roles = (Role.ROBOT,) if robot else (Role.OPERATOR, Role.OBSERVER)
        return robot in ("", each.by) and any(
            was_signed(self.manifest, each.by, each.content, each.signature, role) for role in roles
        )

    def _missing_end(self, recording: Recording, last: Signature | None) -> str:
        if self.is_running and not recording.is_finished:
            return "it is still written"
        return _with_torn(self._explained_end(recording, last), recording)

    def _explained_end(self, recording: Recording, last: Signature | None) -> str:
        """Return why a recording has no end, from the other recordings.

        Without an explanation, add a gap.
        """
        robot, life = recording.metadata.robot, _last_life(recording)
        if robot and life is None:
            self._open_end(recording, last)
            return "no end: killed before it joined"
        found = sorted(self._deaths(recording, life)) if life is not None else []
        last_us = _unix_us(recording, recording.records[-1].at_us)
        if not found:
            return self._finished_end(recording, last)
        at_us, by, looked_us, _ = found[0]
        timing = recording.metadata.timing
        # A recording that began later, or whose robot joined later, has not watched before: all may
        # have ended at once, and a robot that hears nobody waits long before it joins.
        silent_us = at_us - max(last_us, looked_us)
        if silent_us - timing.max_detection_us - SIGN_US > CLOCKS_US:
            text = f"it ends {silent_us / 1e6:.1f} s before {by} noticed the end of {robot}"
            self._gap(GapKind.END, recording.name, text, "give the whole file")
        at_s = (at_us - _unix_us(recording, recording.begin_us)) / 1e6
        self._open_end(recording, last)
        others = ", ".join(sorted({name for _, name, *_ in found}))
        return f"no end: killed ({others} noticed, at {at_s:.3f} s first)"

    def _open_end(self, recording: Recording, last: Signature | None) -> None:
        """Add a gap if nothing that was signed at the run's end says how far a recording goes."""
        if self.is_run_dir and not self.is_running and not finished_by(recording, self.finished):
            text = f"signed until {_seconds(recording, last.until_us)} s" if last else "not signed"
            text += f", and no {SUMMARY_FILE} that was signed at the run's end says how far it goes"
            self._gap(GapKind.END, recording.name, text, _ACCEPT_END)

    def _finished_end(self, recording: Recording, last: Signature | None) -> str:
        """Return who says that a recording had ended abruptly; without anybody, add a gap."""
        by = finished_by(recording, self.finished)
        if by and not self._ends_early(recording):
            return f"no end: ended abruptly (nobody wrote it any more when {by} was written)"
        if self.is_running and self._has_just_ended(recording):
            return "no end: it has just ended, and others may still notice why"
        robot, until_us = recording.metadata.robot, recording.records[-1].at_us
        signed = f"signed until {_seconds(recording, last.until_us)} s" if last else "not signed"
        text = f"it ends abruptly at {_seconds(recording, until_us)} s ({signed})"
        if robot:
            text += f", and nothing says that {robot} died"
        elif recording.metadata.has_summary:
            text += f": its observer ended before it wrote {SUMMARY_FILE}"
        self._gap(GapKind.END, recording.name, _with_torn(text, recording), _ACCEPT_END)
        return "no end"

    def _has_just_ended(self, recording: Recording) -> bool:
        """Return whether the others had no time yet to notice the end of its robot."""
        last_us = max(
            _unix_us(each, each.records[-1].at_us)
            for each in (check.recording for check in self.checks)
            if each.records
        )
        silent_us = last_us - _unix_us(recording, recording.records[-1].at_us)
        return silent_us <= recording.metadata.timing.max_detection_us + SIGN_US

    def _ends_early(self, recording: Recording) -> bool:
        """Return whether robots went on for longer than they do without what launched them."""
        end_us = _unix_us(recording, recording.records[-1].at_us)
        known = (check.recording for check in self.checks if not recording.metadata.robot)
        others = [each for each in known if each.records]
        begun = [each for each in others if _unix_us(each, each.begin_us) <= end_us]
        last_us = max((_unix_us(each, each.records[-1].at_us) for each in begun), default=end_us)
        return last_us - end_us > round(LEAVE_LIMIT_S * 1e6) + CLOCKS_US

    def _deaths(
        self, recording: Recording, life: Incarnation
    ) -> Iterator[tuple[int, str, int, bool]]:
        """Yield (Unix time, file, watching since, whether its owner held the robot for dead) of
        recordings in which this life is over.
        """
        robot = recording.metadata.robot
        for check in self.checks:
            other = check.recording
            looked_at = other.records.of(channels.ROBOTS, channels.LIFE)
            for each in looked_at if other is not recording else ():
                if (
                    each.topic == channels.ROBOTS
                    and each.data["robot"] == robot
                    and _is_over(life, read_incarnation(each.data["incarnation"]), each.data)
                ) or (
                    other.metadata.robot == robot
                    and each.topic == channels.LIFE
                    and each.data["event"] == "joined"
                    and read_incarnation(each.data["incarnation"]) > life
                ):
                    # The time is not known if it was noticed in a part that was not kept.
                    is_known = each.number > check.state_until
                    end_us = _unix_us(recording, recording.records[-1].at_us)
                    at_us = _unix_us(other, each.at_us) if is_known else end_us
                    is_this = read_incarnation(each.data["incarnation"]) == life
                    is_dead = is_this and each.data.get("state") == "dead"
                    yield at_us, other.name, _unix_us(other, _joined_us(other)), is_dead
                    break

    # -- what robots have said of their recordings --------------------------------------------

    def _heads(self) -> None:
        """Check what robots have heard about how far other robots had signed their recordings."""
        owners = {
            (check.recording.metadata.robot, life.nonce): check
            for check in self.checks
            for life in lives(check.recording)
        }
        for owner in {id(each): each for each in owners.values()}.values():
            self._heads_of(owner, owners)

    def _heads_of(
        self, owner: RecordingCheck, owners: Mapping[tuple[str, str], RecordingCheck]
    ) -> None:
        """Check the heads of one recording: the last one that others heard, and the first that it
        lacks.

        A recording that ends before the former has a gap. It is a contradiction if it was ended and
        signed so, as is the latter.
        """
        recording = owner.recording
        if not recording.records:
            return
        signed = {each.number - 1: each.check for each in recording.signatures}
        last = recording.records[-1].number
        is_ended = any(each.is_end for each in recording.signatures)
        later: list[tuple[int, str]] = []
        false: list[tuple[int, str]] = []
        for check, each in self._heard_of(owner, owners):
            owner.counts["heads"] += 1
            number, head = each.data["number"], bytes.fromhex(each.data["head"])
            if number <= recording.metadata.after_number:
                continue  # it is from a part that was not kept
            if number >= last:
                later.append((_unix_us(check.recording, each.at_us), check.recording.name))
            elif signed.get(number) != head:
                false.append((number, check.recording.name))
        if later:
            at_us, by = max(later)
            heard_s = (at_us - _unix_us(recording, recording.begin_us)) / 1e6
            end_s = (recording.records[-1].at_us - recording.begin_us) / 1e6
            text = f"it ends at {end_s:.3f} s, and {by} heard of its records until {heard_s:.3f} s"
            if is_ended:
                owner.add(recording.records[-1], text, {name for _, name in later})
            else:
                self._gap(GapKind.END, recording.name, text, "give the whole file")
        if false:
            number = min(false)[0]
            against = {by for each, by in false if each == number}
            robot = recording.metadata.robot
            text = f"what was recorded before is not what {robot} has told others that it signed"
            owner.add(_record(recording, number), text, against)

    def _heard_of(
        self, owner: RecordingCheck, owners: Mapping[tuple[str, str], RecordingCheck]
    ) -> Iterator[tuple[RecordingCheck, RecordedMessage]]:
        """Yield what other recordings have about the heads of this one."""
        for check in self.checks:
            heads = check.recording.records.of(channels.HEADS)
            for each in heads if check is not owner else ():
                nonce = read_incarnation(each.data["incarnation"]).nonce
                if owners.get((each.data["robot"], nonce)) is owner:
                    yield check, each

    # -- all of them ----------------------------------------------------------------------------

    def _missing_lives(self) -> None:
        """Report robots that others counted on without a recording of that life."""
        there = {
            (check.recording.metadata.robot, life)
            for check in self.checks
            for life in lives(check.recording)
        }
        late = {
            (check.recording.metadata.robot, check.begins_after.incarnation.nonce)
            for check in self.checks
            if check.begins_after is not None
        }
        counted_on: dict[tuple[str, Incarnation], str] = {}
        for check in self.checks:
            for each in check.recording.records.of(channels.ALIVE):
                for robot, text in each.data["robots"].items():
                    life = read_incarnation(text)
                    counted_on.setdefault((robot, life), check.recording.name)
        for (robot, life), file in sorted(counted_on.items()):
            # Earlier lives of the same process were recorded in parts that were not kept.
            if (robot, life) not in there and (robot, life.nonce) not in late:
                text = f"no recording of its life {life} is here, with which {file} counts"
                remedy = f"give recordings/{robot}.mcap, or its next file, of its computer"
                self._gap(GapKind.ROBOT, robot, text, remedy)


def _record(recording: Recording, number: int) -> RecordedMessage:
    """Return the record of this number, or the last one before it."""
    before = (each for each in reversed(recording.records) if each.number <= number)
    return next(before, recording.records[0])


def _with_torn(text: str, recording: Recording) -> str:
    return f"{text} ({recording.torn})" if recording.torn else text


def lives(recording: Recording) -> list[Incarnation]:
    """Return the incarnations that a robot had while it recorded, in order."""
    return [
        read_incarnation(record.data["incarnation"])
        for record in recording.records.of(channels.LIFE, channels.PARTS)
        if record.data.get("event", "joined") == "joined" and record.data["incarnation"]
    ]


def _joined_us(recording: Recording) -> int:
    """Return when the robot began to watch the others; an observer watches from the beginning."""
    joined = (
        each.at_us for each in recording.records.of(channels.LIFE) if each.data["event"] == "joined"
    )
    return next(joined, recording.begin_us)


def _last_life(recording: Recording) -> Incarnation | None:
    return max(lives(recording), default=None)


def _is_over(life: Incarnation, known: Incarnation, data: object) -> bool:
    return known > life or (known == life and isinstance(data, dict) and data["state"] == "dead")


def _seconds(recording: Recording, at_us: int) -> str:
    return f"{max(0, at_us - recording.begin_us) / 1e6:.3f}"


def _unix_us(recording: Recording, at_us: int) -> int:
    return recording.metadata.epoch_ns // 1_000 + at_us
