"""The complete analysis of a mission as data, as printed by `mrbt analyze`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from mrbt_mesh.analysis.tolerance.advice import Additions, advise
from mrbt_mesh.analysis.tolerance.fault_counts import Tolerance, tolerance
from mrbt_mesh.analysis.tolerance.model import Answer
from mrbt_mesh.analysis.tolerance.readings import READINGS, Question
from mrbt_mesh.analysis.tolerance.service import Fault, FaultyTeam, capability_faults, robot_faults
from mrbt_mesh.core.mission.mission import Costs, Mission, majority
from mrbt_mesh.features.constraints.kinds import constraints_of
from mrbt_mesh.formats.cautions import cautions

# Called with the current question, the number of those done, and their total.
Say = Callable[[str, int, int], None]

SERIAL = "serial"
# Whether robots, and whether capabilities, may be added: as the fields of Advice.
ADVICE_KINDS = ((True, True), (True, False), (False, True))
MAX_SHOWN = 5
ASSUMPTIONS = (
    "Faults happen before a task starts; what is done stays done.",
    "A task is feasible if all its needs find their min robots at one time, no robot twice.",
    "The tree runs serially if need be: a required task has to be feasible alone.",
    "Each condition or comparison may read either value each time it is read; values with which "
    "the tree could not succeed even if every task were feasible do not count.",
    "A feasible task succeeds or fails as the mission needs it; an infeasible one blocks for "
    "ever, or fails with blocked: {fail_after_s}.",
    "A task with same_robot_as is for the robots that did another one, which may be any that could "
    "have, and may be lost in between. Conditions alone take a living robot, too.",
    "An exclusive task needs a living majority of the robots that the mission names; minor faults "
    "leave a robot alive.",
)


_SIDE_CONSTRAINTS = (
    "The mission's side constraints ({}) are NOT taken into account: with them, fewer faults may "
    "be survived."
)


def assumptions(mission: Mission) -> tuple[str, ...]:
    """Return what the figures are based on, and what they ignore in this mission."""
    left_out = [str(constraint) for constraint in constraints_of(mission)]
    own = sorted(
        {
            name
            for g in mission.entries.guards.values()
            for name, _ in g
            if mission.entries.is_own(name)
        }
    )
    left_out += [f"{name}, which every robot has for itself" for name in own]
    if not left_out:
        return ASSUMPTIONS
    shown = "; ".join(left_out[:MAX_SHOWN]) + ("; ..." if len(left_out) > MAX_SHOWN else "")
    return (_SIDE_CONSTRAINTS.format(shown), *ASSUMPTIONS)


@dataclass(frozen=True)
class ReadingResult:
    """The result of one reading for both kinds of faults."""

    question: Question
    major: Tolerance
    minor: Tolerance

    @property
    def is_weak(self) -> bool:
        """True if every single minor fault is survived."""
        return self.question.reading.is_feasible and not self.minor.critical

    @property
    def is_strong(self) -> bool:
        """True if every single major fault is survived."""
        return self.question.reading.is_feasible and not self.major.critical


@dataclass(frozen=True)
class TaskSlack:
    """How many robots, whichever they are, a global task can lose (-1: infeasible).

    `needs`: local task, nu, capable robots. `is_indispensable`: if infeasible, it alone ruins the
    mission.
    """

    task: str
    slack: int
    needs: tuple[tuple[str, int, int], ...]
    is_indispensable: bool
    is_exclusive: bool


@dataclass(frozen=True)
class Advice:
    """Additions for one kind of tolerance: the cheapest, only robots, and only capabilities."""

    cheapest: Additions
    robots_only: Additions
    capabilities_only: Additions


@dataclass(frozen=True)
class Analysis:
    """The results about a mission's fault tolerance."""

    mission: Mission
    readings: dict[str, ReadingResult]
    tasks: tuple[TaskSlack, ...]
    weak_advice: Advice
    strong_advice: Advice
    cautions: tuple[str, ...]

    @property
    def main(self) -> ReadingResult:
        """The default reading."""
        return self.readings[SERIAL]

    @property
    def is_complete(self) -> bool:
        """True if every figure is proved, because no time limit was reached."""
        proved = [
            answer.is_proved
            for result in self.readings.values()
            for kind in (result.major, result.minor)
            for answer in (kind.max_tolerated, kind.min_fatal)
        ]
        for advice in (self.weak_advice, self.strong_advice):
            ways = (advice.cheapest, advice.robots_only, advice.capabilities_only)
            proved += [each.is_proved for each in ways]
        return all(proved)

    def to_json(self) -> dict[str, Any]:
        """Return plain data; the keys are documented in docs/how-to/analyze.md."""
        main = _reading_json(self.main)
        others = {
            name: _reading_json(result) for name, result in self.readings.items() if name != SERIAL
        }
        robots = self.mission.robots
        exclusive = [each.task for each in self.tasks if each.is_exclusive]
        return {
            "mission": self.mission.name,
            "robots": len(robots),
            "capabilities": sum(len(robot.capabilities) for robot in robots.values()),
            **main,
            **others,
            "complete": self.is_complete,
            "exclusive": {
                "tasks": exclusive,
                "majority": majority(robots),
                "max_major_faults": len(robots) - majority(robots) if exclusive else None,
            },
            "tasks": [
                {
                    "task": each.task,
                    "slack": each.slack,
                    "indispensable": each.is_indispensable,
                    "exclusive": each.is_exclusive,
                    "needs": [
                        {"local_task": name, "min": least, "capable": able, "spare": able - least}
                        for name, least, able in each.needs
                    ],
                }
                for each in self.tasks
            ],
            "advice": {
                "weakly_fault_tolerant": _advice_json(self.weak_advice),
                "strongly_fault_tolerant": _advice_json(self.strong_advice),
            },
            "cautions": list(self.cautions),
            "assumptions": list(assumptions(self.mission)),
        }


def analyse(mission: Mission, costs: Costs, limit_s: float, say: Say = lambda *_: None) -> Analysis:
    """Analyse a mission; each question to a solver gets at most `limit_s` seconds.

    Raises TooLargeError if the tree has too many combinations.
    """
    questions = len(READINGS) + 2 * len(ADVICE_KINDS)
    numbers = iter(range(questions))
    majors, minors = robot_faults(mission), capability_faults(mission)
    readings = {}
    for name, ask in READINGS.items():
        say(name.replace("_", " "), next(numbers), questions)
        question = ask(mission)
        major, minor = (tolerance(question.reading, each, limit_s) for each in (majors, minors))
        readings[name] = ReadingResult(question, major, minor)
    reading = readings[SERIAL].question.reading

    def advice(is_strong: bool) -> Advice:
        found = []
        for kinds in ADVICE_KINDS:
            what = f"advice for {'strong' if is_strong else 'weak'} tolerance"
            say(what, next(numbers), questions)
            found.append(advise(reading, is_strong, costs, limit_s, kinds))
        return Advice(*found)

    tasks = _slacks(readings["keeps_every_task"].question, set(reading.required.indispensable))
    advices = advice(False), advice(True)
    return Analysis(mission, readings, tasks, *advices, tuple(cautions(mission)))


def _slacks(question: Question, indispensable: set[int]) -> tuple[TaskSlack, ...]:
    reading = question.reading
    team = FaultyTeam(reading.mission)
    found = []
    for task in reading.mission.global_tasks:
        numbers = [n for n, each in enumerate(reading.services) if each.tasks == (task,)]
        first, *bound = (reading.services[number] for number in numbers)
        found.append(
            TaskSlack(
                task,
                min(team.slack(each) for each in (first, *bound)),
                tuple((need.local_task, need.count, len(need.entries)) for need in first.needs),
                not indispensable.isdisjoint(numbers),
                first.exclusive,
            )
        )
    return tuple(found)


# -- JSON -------------------------------------------------------------------------------------


def fault_json(fault: Fault) -> Any:
    """Return a robot's id, or {"robot": ..., "capability": ...}."""
    return fault if isinstance(fault, str) else {"robot": fault[0], "capability": fault[1]}


def _reading_json(result: ReadingResult) -> dict[str, Any]:
    return {
        "feasible": result.question.reading.is_feasible,
        "obstacle": result.question.obstacle or None,
        "weakly_fault_tolerant": result.is_weak,
        "strongly_fault_tolerant": result.is_strong,
        "major": _tolerance_json(result.major),
        "minor": _tolerance_json(result.minor),
    }


def _tolerance_json(kind: Tolerance) -> dict[str, Any]:
    return {
        "total": kind.total,
        "max_tolerated": kind.max_tolerated.value,
        "max_tolerated_bounds": _bounds(kind.max_tolerated, is_most=True),
        "max_tolerated_example": [fault_json(each) for each in kind.max_tolerated.chosen],
        "min_fatal": kind.min_fatal.value,
        "min_fatal_bounds": _bounds(kind.min_fatal, is_most=False),
        "min_fatal_example": [fault_json(each) for each in kind.min_fatal.chosen],
        "critical": [fault_json(each) for each in kind.critical],
    }


def _bounds(answer: Answer, is_most: bool) -> list[int | None]:
    """Return the [least, most] that the true figure can be; equal if it is proved."""
    ends = [answer.value, answer.bound]
    return ends if is_most else ends[::-1]


def _advice_json(advice: Advice) -> dict[str, Any]:
    return {
        name: {
            "cost": each.cost,
            "bound": each.bound,
            "proved": each.is_proved,
            "robots": dict(each.robots),
            "capabilities": [fault_json(entry) for entry in each.capabilities],
        }
        for name, each in (
            ("cheapest", advice.cheapest),
            ("robots_only", advice.robots_only),
            ("capabilities_only", advice.capabilities_only),
        )
    }
