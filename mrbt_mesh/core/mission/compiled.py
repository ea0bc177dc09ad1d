"""Compiled missions: canonical JSON that robots load without YAML or pydantic."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping

from mrbt_mesh.core.bt.tree import MAX_NODES, Kind
from mrbt_mesh.core.feature import used
from mrbt_mesh.core.mission.conditions import ConditionType
from mrbt_mesh.core.mission.failure_reasons import CONTAINS, EQUALS, GLOBAL, LOCAL
from mrbt_mesh.core.mission.jobs import may_be_above_jobs, most_nodes, with_one_of_each
from mrbt_mesh.core.mission.mission import (
    MAX_AT_MOST,
    MAX_CHOICES,
    MAX_COST,
    MAX_GLOBAL_TASKS,
    MAX_NUMBER,
    MAX_PERFORMANCE,
    MAX_PRIORITY,
    MAX_ROBOTS,
    JobParameter,
    Mission,
    MissionEnd,
    mission_from_json,
    travel_problems,
)
from mrbt_mesh.core.mission.names import (
    ARGUMENT_PATTERN,
    MAX_ARGUMENTS,
    NAME_PATTERN,
    is_robot_id,
    split_call,
    type_name,
)
from mrbt_mesh.core.mission.travel import MAX_HORIZON, MAX_MS, MAX_OVERTAKING
from mrbt_mesh.errors import FileError, Problem, whole_file_error

# Of a digest in hexadecimal digits.
DIGEST_LENGTH = 64


def compile_mission(mission: Mission) -> str:
    """Canonical JSON text with sorted keys; equal missions give equal text.

    Raises ValueError if a parameter is no finite JSON value.
    """
    text = json.dumps(mission.to_json(), sort_keys=True, separators=(",", ":"), allow_nan=False)
    return text + "\n"


def mission_from_compiled(text: str, file: str) -> Mission:
    """The mission in the JSON `text`. Raises FileError if it was damaged or written by hand."""
    try:
        data = json.loads(text)
        if not isinstance(data, dict) or "compiled" not in data:
            raise ValueError("not a compiled mission; `mrbt validate --compile` writes one")
        mission = mission_from_json(data)
        json.dumps(mission.parameters, allow_nan=False)
        _check(mission)
    except json.JSONDecodeError as error:
        message = f"not valid JSON: {error.msg} (column {error.colno})"
        raise FileError([Problem(file, error.lineno, "", message)]) from None
    except RecursionError:
        raise whole_file_error(file, "not valid JSON: nested too deep") from None
    except (ValueError, LookupError) as error:
        said = " ".join(str(error).split())
        raise whole_file_error(file, f"{said}; compile the mission again") from None
    return mission


def _expect(is_right: bool, what: str) -> None:
    if not is_right:
        raise ValueError(f"compiled mission is damaged: {what}")


def _check_capabilities(capabilities: Mapping[str, int], owner: str, mission: Mission) -> None:
    for ground, value in capabilities.items():
        split_call(ground)
        _expect(type_name(ground) in mission.local_tasks, f"{owner}: unknown capability {ground!r}")
        _expect(1 <= value <= MAX_PERFORMANCE, f"{owner}: performance {value}")


def _check(mission: Mission) -> None:
    """Ranges and cross-references: what reading the YAML form has checked."""
    _check_jobs(mission)
    mission = with_one_of_each(mission)
    _expect(1 <= len(mission.robots) <= MAX_ROBOTS, f"{len(mission.robots)} robots")
    _expect(len(mission.global_tasks) <= MAX_GLOBAL_TASKS, "too many global tasks")
    for robot in mission.robots.values():
        _expect(is_robot_id(robot.id), f"robot id {robot.id!r}")
        _expect(robot.type in mission.robot_types, f"robot {robot.id}: type {robot.type!r}")
        _check_capabilities(robot.capabilities, f"robot {robot.id}", mission)
    for kind, capabilities in mission.robot_types.items():
        _check_capabilities(capabilities, f"robot type {kind}", mission)
    for feature, section in used(mission.sections):
        problem = feature.problem(section, mission)
        _expect(problem is None, problem or "")
    for task in mission.local_tasks.values():
        _expect(task.work > 0, f"local task {task.name}: work")
    for costs in (mission.costs.robots, mission.costs.capabilities):
        for name, cost in costs.items():
            _expect(0 <= cost <= MAX_COST, f"cost of {name}: {cost}")
    for condition in mission.conditions.values():
        _check_condition(condition)
        failure = condition.failure
        if failure is not None:
            names = {argument[1:] for argument in failure.arguments if argument.startswith("$")}
            fits = names == set(condition.parameters) and not condition.default
            fits &= failure.kind in (GLOBAL, LOCAL) and failure.match in (EQUALS, CONTAINS)
            _expect(fits, f"condition {condition.name}: failure reason")
    _check_global_tasks(mission)
    _check_nodes(mission)
    _check_program_trees(mission)
    _check_travel(mission)


def _check_condition(condition: ConditionType) -> None:
    traits, default = condition.traits, condition.default
    fits = type(default) is bool if traits is None else traits.fits(default)
    _expect(fits, f"condition {condition.name}")


def _check_jobs(mission: Mission) -> None:
    nodes, places = mission.tree.nodes, mission.travel.places if mission.travel else ()
    for known in mission.jobs.values():
        here = f"job type {known.name}"
        _expect(re.fullmatch(NAME_PATTERN, known.name) is not None, here)
        names = [each.name for each in known.parameters]
        _expect(len({*names}) == len(names) <= MAX_ARGUMENTS, f"{here}: parameters")
        for each in known.parameters:
            _check_job_parameter(each, f"{here}: parameter {each.name!r}")
        _expect(0 <= known.priority <= MAX_PRIORITY, f"{here}: priority")
        _expect(known.deadline_us is None or known.deadline_us > 0, f"{here}: deadline")
        own = (known.global_tasks, known.at, known.program_trees)
        _expect(all("{" in name for of_job in own for name in of_job), f"{here}: ground names")
        at = all(each in places for place in known.at.values() for each in known.values(place))
        _expect(at, f"{here}: places")
    types = [nodes[child].name for n in nodes if n.kind is Kind.JOBS for child in n.children]
    _expect(sorted(types) == sorted(mission.jobs), "each job type is in one Jobs node")
    for node in nodes:
        if node.kind is Kind.JOBS:
            _expect(1 <= node.limit <= MAX_AT_MOST, "jobs at a time")
            kinds = {nodes[child].kind for child in node.children}
            _expect(kinds == {Kind.SUBTREE}, "children of Jobs")
            above = node.parent
            while above >= 0:
                _expect(may_be_above_jobs(nodes[above].kind, nodes[above].memory), "above Jobs")
                above = nodes[above].parent
    _expect(most_nodes(mission.tree) <= MAX_NODES, "too many nodes of jobs")
    has_end = any(known.ends_mission for known in mission.jobs.values())
    _expect(
        not types or has_end or mission.ends is MissionEnd.NEVER, "it waits for jobs and never ends"
    )


def _check_job_parameter(parameter: JobParameter, here: str) -> None:
    _expect(re.fullmatch(NAME_PATTERN, parameter.name) is not None, here)
    choices = parameter.choices
    fitting = [each for each in choices if re.fullmatch(ARGUMENT_PATTERN, each)]
    _expect(len({*fitting}) == len(choices) <= MAX_CHOICES, f"{here}: choices")
    low, high = parameter.low, parameter.high
    _expect(-MAX_NUMBER <= low <= high <= MAX_NUMBER, f"{here}: numbers")


def _check_global_tasks(mission: Mission) -> None:
    for goal in mission.global_tasks.values():
        here = f"global task {goal.id}"
        split_call(goal.id)
        for key, after in (
            ("blocked", goal.blocked_fail_after_us),
            ("failure", goal.failure_after_us),
        ):
            _expect(after is None or after > 0, f"{here}: {key}")
        for condition, _ in goal.effects:
            _expect(mission.entries.knows(condition), f"{here}: effect on {condition!r}")
        problem = goal.joint.problem() if goal.joint is not None else ""
        _expect(not problem, f"{here}: {problem}")
        _expect(any(need.min_robots for need in goal.needs), f"{here}: no robot is needed")
        _expect(all(each in mission.conditions for each in goal.reads), f"{here}: entries")
        for need in goal.needs:
            name, arguments = split_call(need.local_task)
            declared = mission.local_tasks.get(name)
            fits = declared is not None and len(declared.parameters) == len(arguments)
            _expect(fits, f"{here}: local task {need.local_task!r}")
            low, high = need.min_robots, need.max_robots
            in_order = 0 <= low <= high and 1 <= high <= MAX_ROBOTS
            _expect(in_order, f"{here}: bounds of {need.local_task}")
            before = need.same_robot_as
            if before is not None:
                earlier = mission.global_tasks.get(before.global_task)
                known = {each.local_task for each in earlier.needs} if earlier else set()
                _expect(before.local_task in known, f"{here}: same_robot_as")
            rule = need.performance_rule
            problem = rule.problem() if rule is not None else ""
            _expect(not problem, f"{here}: performance of {need.local_task}: {problem}")


def _check_program_trees(mission: Mission) -> None:
    for name, tree in mission.program_trees.items():
        split_call(name)
        _expect(type_name(name) in mission.local_tasks, f"tree of {name}: unknown local task")
        for _, condition in tree.outputs:
            _expect(mission.entries.knows(condition), f"tree of {name}: output {condition!r}")


def _check_travel(mission: Mission) -> None:
    if (travel := mission.travel) is None:
        return
    known = all(kind in mission.robot_types and n > 0 for kind, n in travel.speeds.items())
    _expect(known, "speeds")
    for way, ms in travel.ways_ms.items():
        _expect({*way} <= travel.places.keys() and 0 <= ms <= MAX_MS, f"way {way}")
    _expect(travel.at.keys() <= mission.local_task_types.keys(), "places of local tasks")
    _expect(travel.start.keys() <= mission.robots.keys(), "places of robots")
    for place in (*travel.at.values(), *travel.start.values()):
        _expect(place in travel.places, f"place {place!r}")
    _expect(1 <= travel.horizon <= MAX_HORIZON, f"horizon {travel.horizon}")
    _expect(0 <= travel.overtaking <= MAX_OVERTAKING, f"overtaking {travel.overtaking}")
    for _, problem in travel_problems(travel, mission.robots.values(), mission.jobs.values()):
        _expect(False, problem)


def _check_nodes(mission: Mission) -> None:
    for node in mission.tree.nodes:
        here = f"tree node {node.index}"
        if node.kind is Kind.ACTION:
            _expect(node.subject in mission.global_tasks, f"{here}: {node.subject!r}")
        elif node.kind is Kind.CONDITION:
            _expect(mission.entries.is_condition(node.subject), f"{here}: {node.subject!r}")
