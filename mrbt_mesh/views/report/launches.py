"""The launches of a run, from its recordings, and how each of them ended.

A run that is continued is launched again. Between two launches nobody records.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

from mrbt_mesh.recording import channels
from mrbt_mesh.recording.reader import Recording
from mrbt_mesh.runtime.command_log import CONTINUE, DOWN, NotedCommand
from mrbt_mesh.views.replay.findings import End, Verification
from mrbt_mesh.views.report.model import ENDED, NOT_KNOWN, RUNNING, RobotUse, RunReport

_OVER = ("success", "failure", "not_started")
# What an observer says of a mission that was on its way.
_UNFINISHED = "timeout"
_GONE = ("dead", "left")
# Robots may record for so long after an operator's command has ended them, and before it is noted.
LEAVING_S = 1.0


@dataclass(frozen=True)
class Launch:
    """The recordings of one launch, by their begin; times are Unix times in microseconds."""

    recordings: tuple[Recording, ...]

    @property
    def begin_us(self) -> int:
        """When the first of them begins."""
        return _began_unix_us(self.recordings[0])

    @property
    def end_us(self) -> int:
        """The time of the last record."""
        return max(map(_ended_unix_us, self.recordings))

    @property
    def shown(self) -> list[Recording]:
        """Those of its observers; without one, that of the robot that recorded for longest."""
        observed = [each for each in self.recordings if not each.metadata.robot]
        return observed or [max(self.recordings, key=_length_us)]

    @property
    def last(self) -> dict[str, Recording]:
        """Robot -> its last recording."""
        return {r.metadata.robot: r for r in self.recordings if r.metadata.robot}

    def died_us(self, proof: Verification, observed: Recording) -> dict[str, int]:
        """Robot -> when its recording ends on the clock of another one, if others saw it die."""
        epoch_us = observed.metadata.epoch_ns // 1_000
        return {
            robot: _ended_unix_us(each) - epoch_us
            for robot, each in sorted(self.last.items())
            if proof.ends.get(each.name) is End.KILLED
        }

    def has(self, command: NotedCommand) -> bool:
        """Return whether an operator gave it while this launch ran."""
        begin_s, end_s = self.begin_us / 1e6, self.end_us / 1e6
        return command.unix_s is not None and begin_s <= command.unix_s <= end_s + LEAVING_S


def launches_of(recordings: Iterable[Recording]) -> list[Launch]:
    """Return the launches of a run's recordings, in order. Those without records are left out."""
    found: list[list[Recording]] = []
    end_us = -math.inf
    for each in sorted(
        (each for each in recordings if each.records),
        key=lambda each: (_began_unix_us(each), len(each.name), each.name),
    ):
        if _began_unix_us(each) > end_us:
            found.append([])
        found[-1].append(each)
        end_us = max(end_us, _ended_unix_us(each))
    return [Launch(tuple(each)) for each in found]


def commands_of(
    launches: Sequence[Launch], commands: Iterable[NotedCommand]
) -> list[list[NotedCommand]]:
    """Return the commands of each launch; one between two launches belongs to the later one.

    A line that was cut off is left out.
    """
    found: list[list[NotedCommand]] = [[] for _ in launches]
    for each in commands:
        if each.unix_s is not None:
            later = (at for at, launch in enumerate(launches) if _is_by_end(each.unix_s, launch))
            found[next(later, -1)].append(each)
    return found


def _is_by_end(unix_s: float, launch: Launch) -> bool:
    return unix_s <= launch.end_us / 1e6 + LEAVING_S


def missing_launches(launches: Sequence[Launch], commands: Iterable[NotedCommand]) -> str:
    """Return a note on the launches that operators noted, and of which nothing is here, or an
    empty text.
    """
    continued = [n.unix_s for n in commands if n.by == CONTINUE and n.unix_s is not None]
    bounds = [-math.inf, *sorted(continued), math.inf]
    begins = [each.begin_us / 1e6 for each in launches]
    missing = [
        number
        for number in range(1, len(bounds))
        if not any(bounds[number - 1] <= each < bounds[number] for each in begins)
    ]
    if not missing:
        return ""
    names = ", ".join(map(str, missing))
    return f"of {len(bounds) - 1} launches those without a recording here are left out: {names}"


def with_ends(
    found: RunReport,
    launch: Launch,
    observed: Recording,
    proof: Verification,
    commands: Sequence[NotedCommand],
    is_told: bool,
) -> RunReport:
    """Return the report of a launch with the ends that `verify` has found of its recordings.

    `observed`: the reported recording. `commands`: those of this launch. `is_told`: a summary tells
    the result, and who was alive.
    """
    if found.result in _OVER:
        return found
    ends = {robot: proof.ends.get(each.name) for robot, each in launch.last.items()}
    left = {robot for robot, each in launch.last.items() if _has_left(each)}
    robots = tuple(_with_end(each, ends.get(each.robot), left, is_told) for each in found.robots)
    found = replace(found, robots=robots)
    if is_told:
        return found
    names = [each.robot for each in robots if each.state == NOT_KNOWN]
    notes = found.notes
    if names:
        text = "end abruptly, and no signed summary.json tells how it ended for them"
        notes = (*notes, f"the recordings of {', '.join(names)} {text}")
    result = _result(found, launch, proof.ends.get(observed.name), commands)
    return replace(found, result=result, notes=notes)


def _with_end(robot: RobotUse, end: End | None, left: set[str], is_told: bool) -> RobotUse:
    if robot.state in _GONE:
        return robot
    if end is End.ABRUPT and not is_told:
        return replace(robot, state=NOT_KNOWN)
    return replace(robot, state="left") if end is End.CLOSED and robot.robot in left else robot


def _result(
    found: RunReport, launch: Launch, end: End | None, commands: Sequence[NotedCommand]
) -> str:
    """Return the result of a launch of which no summary tells it."""
    if any(each.by == DOWN and launch.has(each) for each in commands):
        return ENDED
    if found.robots and all(each.state == NOT_KNOWN for each in found.robots):
        return NOT_KNOWN
    if end is End.WRITTEN:
        return RUNNING if found.result == _UNFINISHED else found.result
    # A time that was up, or an operator at the terminal: only the summary has it.
    is_known = end is End.CLOSED and found.result != _UNFINISHED
    return found.result if is_known else NOT_KNOWN


def _has_left(recording: Recording) -> bool:
    """Return whether its robot left the team at last."""
    events = [each.data["event"] for each in recording.records.of(channels.LIFE)]
    return events[-2:] == ["leaving", "stopped"]


def _began_unix_us(recording: Recording) -> int:
    """Return the Unix time of a recording's first record."""
    return recording.metadata.epoch_ns // 1_000 + recording.begin_us


def _ended_unix_us(recording: Recording) -> int:
    return recording.metadata.epoch_ns // 1_000 + recording.records[-1].at_us


def _length_us(recording: Recording) -> int:
    return recording.records[-1].at_us - recording.begin_us
