"""The figures of a report.

Times are in seconds from the start of the run, when the first robot joined; `detected_us` and
`taken_over_us` count from a fault.
"""

from __future__ import annotations

import enum
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from statistics import median
from typing import Any

# A robot's state, or a run's result: the recordings end before.
NOT_KNOWN = "not known"
# Further results of a run: an operator has ended it, or its team is at work.
ENDED, RUNNING = "ended", "running"


@dataclass(frozen=True)
class ReportedWork:
    """One claim of a robot. `running_s`: when its action began; None: never.

    `to_s`: its end, or that of the run. `end`: done, failed, dropped or died; None: it continued.
    """

    robot: str
    global_task: str
    local_task: str
    from_s: float
    running_s: float | None
    to_s: float
    end: str | None


@dataclass(frozen=True)
class ReportedFault:
    """A robot's death (`lost` is empty), or the capabilities that it lost, with the `reason`.

    `until_s` is None for a permanent fault. `exact`: see `DeathTimes`. `why`: which robots could
    take over, and the state of each at that time.
    """

    robot: str
    at_s: float
    until_s: float | None
    lost: tuple[str, ...] = ()
    detected_us: int | None = None
    taken_over_us: int | None = None
    held: str | None = None
    replacement: str | None = None
    why: str = ""
    reason: str = ""
    exact: bool = False


@dataclass(frozen=True)
class ReportedFailure:
    """A robot failed at a local task; `reason` is from its program, or empty."""

    robot: str
    global_task: str
    local_task: str
    at_s: float | None
    reason: str


@dataclass(frozen=True)
class RobotUse:
    """How a robot spent its time.

    `present_s`: alive in the team; of that `working_s` running local tasks, and `starting_s` with a
    claim that it had not started yet. `done`: the number of local tasks.
    """

    robot: str
    type: str
    state: str
    present_s: float
    working_s: float
    starting_s: float
    done: int

    @property
    def utilisation(self) -> float | None:
        """The share of its time in which it worked, 0 to 1; None if it was never present."""
        return self.working_s / self.present_s if self.present_s > 0 else None


class WaitKind(enum.StrEnum):
    """What waited.

    TASK: a global task that was requested and not served. START: a robot with a claim that it could
    not start yet. IDLE: a robot without a claim.
    """

    TASK = "task"
    START = "start"
    IDLE = "idle"


@dataclass(frozen=True)
class Wait:
    """`who`, a robot or a task, waited for these `robots`, as far as known, for a `reason`."""

    kind: WaitKind
    who: str
    from_s: float
    to_s: float
    reason: str
    robots: tuple[str, ...] = ()

    @property
    def seconds(self) -> float:
        """The duration."""
        return self.to_s - self.from_s


@dataclass(frozen=True)
class Disagreement:
    """A period during which robots reported different plans; `robots`: those unlike most."""

    from_s: float
    to_s: float
    robots: tuple[str, ...]

    @property
    def seconds(self) -> float:
        """The duration."""
        return self.to_s - self.from_s


@dataclass(frozen=True)
class ReportedPlan:
    """A plan, by its position among the run's plans and the start of its digest.

    `from_s`: when the first robot reported it; `agreed_s`: when all in good standing did, None:
    never; `to_s`: when the last one left it for another plan. `since_s`: robot -> when it first
    reported it.
    """

    number: int
    digest: str
    from_s: float
    agreed_s: float | None
    to_s: float
    since_s: dict[str, float]


@dataclass(frozen=True)
class TaskEnd:
    """The result of a global task, and who took part."""

    name: str
    status: str
    robots: tuple[str, ...]


@dataclass(frozen=True)
class ScheduledTask:
    """A task as predicted by the last schedule with it, and what was done.

    The prediction is from when the schedule took effect, `known_s`. `author`: empty for a schedule
    by rules. `began_s`, `ended_s`: of all who took part; None: not begun, not ended well.
    """

    name: str
    author: str
    known_s: float
    robots: tuple[str, ...]
    begins_s: float
    ends_s: float
    done_by: tuple[str, ...]
    began_s: float | None
    ended_s: float | None


@dataclass(frozen=True)
class ReportedCommand:
    """An operator's command, `by` a command or view; `at_s` None: the clock is unknown.

    `signer`: the operator who is proved to have noted it; empty: it is not proved.
    """

    at_s: float | None
    by: str
    command: str
    signer: str


@dataclass(frozen=True)
class ReportedJob:
    """A job, with its fields as in `JobRow`; times in seconds of the run.

    `call`: its type with its arguments.
    """

    id: str
    call: str
    priority: int | None
    submitted_s: float | None
    begun_s: float | None
    ended_s: float | None
    robots: tuple[str, ...]
    state: str
    why: str
    operator: str


@dataclass(frozen=True)
class RunIdentity:
    """Which run it was.

    `began_unix_s`: the Unix time of its second 0; None: virtual time. `run`, `mission_digest`: as
    compared by the robots; `version`: of mrbt.
    """

    began_unix_s: float | None
    run: str
    mission_digest: str
    version: str


@dataclass(frozen=True)
class Proof:
    """The findings of `mrbt recording verify` in these recordings.

    `findings` are contradictions, `gaps` what is not proved. `counts`: checks by kind. `team_key`:
    empty without one.
    """

    recordings: tuple[str, ...]
    team_key: str
    counts: dict[str, int]
    findings: tuple[str, ...]
    gaps: tuple[str, ...]

    @property
    def result(self) -> str:
        """The result in a few words."""
        if self.findings:
            return f"CONTRADICTED: {len(self.findings)} findings"
        if self.gaps:
            return f"not contradicted, and not all is proved: gaps: {len(self.gaps)}"
        return "all proved"


@dataclass(frozen=True)
class RunReport:
    """One run.

    `plans` and `differences` are None if nobody recorded what robots reported. `work` and `waits`
    are None if only a summary is left; `robots` then have only type and state. `identity`, `proof`
    and `commands` are those of a recorded run, `scheduled` of a run that travels, `jobs` of one
    that has any, in the order in which they were submitted. `notes`: what the
    figures lack, and why.
    """

    title: str
    mission: str
    result: str
    duration_s: float
    robots: tuple[RobotUse, ...] = ()
    faults: tuple[ReportedFault, ...] = ()
    tasks: tuple[TaskEnd, ...] = ()
    work: tuple[ReportedWork, ...] | None = None
    waits: tuple[Wait, ...] | None = None
    plans: tuple[ReportedPlan, ...] | None = None
    differences: tuple[Disagreement, ...] | None = None
    notes: tuple[str, ...] = ()
    failures: tuple[ReportedFailure, ...] = ()
    identity: RunIdentity | None = None
    proof: Proof | None = None
    commands: tuple[ReportedCommand, ...] = ()
    scheduled: tuple[ScheduledTask, ...] = ()
    jobs: tuple[ReportedJob, ...] = ()

    @property
    def deaths(self) -> list[ReportedFault]:
        """The major faults."""
        return [fault for fault in self.faults if not fault.lost]

    @property
    def utilisation(self) -> float | None:
        """The utilisation of all robots together; None if their work is not known."""
        present_s = sum(robot.present_s for robot in self.robots)
        worked_s = sum(robot.working_s for robot in self.robots)
        return worked_s / present_s if self.work is not None and present_s > 0 else None

    @property
    def differing_s(self) -> float | None:
        """How long not all robots reported the same plan."""
        if self.differences is None:
            return None
        return sum(each.seconds for each in self.differences)

    def waited_s(self, kind: WaitKind) -> float | None:
        """Return the total time of waits of one kind."""
        if self.waits is None:
            return None
        return sum(wait.seconds for wait in self.waits if wait.kind is kind)

    def to_json(self) -> dict[str, Any]:
        """Return plain data, including derived figures."""
        data = asdict(self)
        for robot, row in zip(self.robots, data["robots"], strict=True):
            row["utilisation"] = None if self.work is None else robot.utilisation
        for wait, row in zip(self.waits or (), data["waits"] or (), strict=True):
            row["seconds"] = wait.seconds
        return {
            **data,
            "utilisation": self.utilisation,
            "differing_s": self.differing_s,
            "detected_us": spread(fault.detected_us for fault in self.deaths),
            "taken_over_us": spread(fault.taken_over_us for fault in self.deaths),
        }


@dataclass(frozen=True)
class RunParts:
    """A run; if it was continued, each launch of it, in order."""

    runs: tuple[RunReport, ...]

    def to_json(self) -> dict[str, Any]:
        """Plain data."""
        return {"runs": [run.to_json() for run in self.runs]}


def spread(values: Iterable[float | None]) -> dict[str, float] | None:
    """Return smallest, median and largest of the known values; None if there are none."""
    known = [value for value in values if value is not None]
    if not known:
        return None
    return {"least": min(known), "median": median(known), "most": max(known)}
