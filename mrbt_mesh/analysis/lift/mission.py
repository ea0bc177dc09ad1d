"""A whole mission from a single robot's tree file and a team file."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from mrbt_mesh.analysis.lift.annotations import annotated
from mrbt_mesh.analysis.lift.belonging import Follows, Ownership, Templates, templates
from mrbt_mesh.analysis.lift.lifter import Lifted, Lifter
from mrbt_mesh.analysis.team_tree import ALWAYS, TeamTree, to_team_tree
from mrbt_mesh.btcpp.files.document import Category
from mrbt_mesh.btcpp.files.library import Library, TreeSource
from mrbt_mesh.btcpp.scripts.values import read_boolean
from mrbt_mesh.core.bt.tree import Kind, NodeSpec
from mrbt_mesh.core.mission.names import split_call, type_name
from mrbt_mesh.errors import FileError, Problem, nearest
from mrbt_mesh.formats.declaration import Declaration
from mrbt_mesh.formats.mission_model import FailureReasonModel
from mrbt_mesh.formats.mission_writer import tree_data
from mrbt_mesh.formats.node_paths import walk
from mrbt_mesh.formats.team_file import TeamFile, TeamTaskModel, UnitTaskModel

INDEPENDENT = "_independent"
MAX_SHOWN = 5


@dataclass(frozen=True)
class LiftedMission:
    """The mission as plain data of a mission file, how it came about, and what was noted."""

    data: Mapping[str, Any]
    lifted: Lifted
    notes: tuple[Problem, ...]


def lift_mission(
    library: Library, tree: str, team: TeamFile, independent: Collection[str], name: str
) -> LiftedMission:
    """Lift the tree called `tree` for a team.

    `independent` names nodes by path or name whose children do not depend on one another.
    Raises FileError with the node's path and line for whatever a team cannot carry out.
    """
    found = to_team_tree(library, tree, Category.ACTION, team.model.conditions)
    mission = lifted_mission(found, team, library.trees[tree], independent, name)
    return replace(mission, notes=(*mission.notes, *_undeclared(found, team)))


def _undeclared(found: TeamTree, team: TeamFile) -> list[Problem]:
    """That actions which declare nothing may each be done by another robot."""
    if found.spec is None:
        return []
    declared = _declarations(found.spec, found, team)
    names = [name for name in _subjects(found.spec, Kind.ACTION) if name not in declared]
    if len(names) < 2 or len(team.model.robots) < 2:
        return []
    shown = ", ".join(names[:MAX_SHOWN]) + (", ..." if len(names) > MAX_SHOWN else "")
    text = f"{shown} declare nothing, and each may be done by another robot; --units auto keeps "
    text += "them on one, and so does declaring what a robot has for itself (per: robot)"
    return [Problem(team.file, 0, "local_tasks", text)]


def lifted_mission(
    found: TeamTree,
    team: TeamFile,
    source: TreeSource,
    independent: Collection[str],
    name: str,
) -> LiftedMission:
    """As `lift_mission`, of a tree that has been translated; its tasks are those of `team`."""
    if found.spec is None:
        raise FileError(found.refusals)
    spec = found.spec
    _check_tasks(spec, team, source)
    declared = _declarations(spec, found, team)
    work_us = {subject: team.work_us(subject) for subject in _subjects(spec, Kind.ACTION)}
    independent_paths = _independent(spec, found, independent)
    lifter = partial(Lifter, declared, work_us, independent_paths)
    own = Ownership(declared, team.belongs_to_robots, team.default)
    _check_capable(_subjects(spec, Kind.ACTION), own.follows(spec), team)
    lifted, rest = lift_with_owners(spec, lifter, own)
    same_robots, unsaid = templates(rest, lambda name: team.parameters(name) or [])
    lifted = replace(lifted, tree=own.renewable(lifted.tree, unsaid))
    left = own.follows(lifted.tree)
    notes = [Problem(team.file, 0, each.action, _whose(each, left)) for each in unsaid]
    notes += [
        Problem(team.file, 0, each.action, _waits(each))
        for each in rest
        if split_call(each.action)[0] in same_robots
    ]
    data = _mission_data(lifted, team, name, same_robots)
    return LiftedMission(data, lifted, (*found.notes, *notes))


def lift_with_owners(
    spec: NodeSpec, lifter: Callable[[], Lifter], own: Ownership
) -> tuple[Lifted, list[Follows]]:
    """Lift a tree so that few actions are left that only one robot can do, and which these are.

    What belongs to a robot is kept together after lifting, or before it where that leaves fewer: it
    may cost parallelism, but then another robot can begin it again.
    """
    lifted = lifter().lift(spec)
    lifted = replace(lifted, tree=own.renewable(lifted.tree))
    rest = own.follows(lifted.tree)
    if rest:
        kept = lifter().lift(own.renewable(spec))
        kept = replace(kept, tree=own.renewable(kept.tree), serial_us=lifted.serial_us)
        if len(own.follows(kept.tree)) < len(rest):
            return kept, own.follows(kept.tree)
    return lifted, rest


def _check_capable(actions: Collection[str], found: Collection[Follows], team: TeamFile) -> None:
    """A team in which nobody can do something that the tree asks for waits there for ever."""
    problems = []
    robots = ", ".join(team.model.robots)
    for action in actions:
        if not team.capable(action):
            text = (
                f"nobody can do {action}: none of {robots} has the capability {type_name(action)}"
            )
            problems.append(
                Problem(team.file, 0, "robots", f"{text}; give it to a robot or a type")
            )
    for each in found:
        pair = (each.before, each.action) if each.before else ()
        if pair and all(map(team.capable, pair)) and not team.capable(*pair):
            able = "; ".join(f"{name}: {', '.join(team.capable(name))}" for name in pair)
            text = f"{each.action} requires {each.condition} of the robot that did {each.before}"
            problems.append(
                Problem(team.file, 0, "robots", f"{text}, but none can do both ({able})")
            )
    if problems:
        raise FileError(problems)


def _whose(each: Follows, left: Collection[Follows]) -> str:
    """How an action is treated whose robot the tree does not determine."""
    if any((row.action, row.condition) == (each.action, each.condition) for row in left):
        return f"requires {each.condition} of its robot, but any robot may be asked: {each.reason}"
    return f"goes to a robot with {each.condition}, and fails if there is none: {each.reason}"


def _waits(each: Follows) -> str:
    return (
        f"is only for the robot that did {each.before}; if that one is lost in between, the "
        "mission waits for it for ever"
    )


def _subjects(spec: NodeSpec, kind: Kind) -> list[str]:
    subjects = [node.spec.subject for node in walk(spec) if node.spec.kind is kind]
    return list(dict.fromkeys(subjects))


def _check_tasks(spec: NodeSpec, team: TeamFile, source: TreeSource) -> None:
    problems = []
    for subject in _subjects(spec, Kind.ACTION):
        name, arguments = split_call(subject)
        parameters = team.parameters(name)
        if parameters is None:
            message = f"action {name!r} is no local task{nearest(name, team.model.local_tasks)}"
        elif len(parameters) != len(arguments):
            message = (
                f"local task {name!r} takes {len(parameters)} arguments, the tree gives it "
                f"{len(arguments)}: {subject}"
            )
        else:
            continue
        problems.append(Problem(team.file, 1, "local_tasks", message))
    if problems:
        where = source.document.file
        problems.append(
            Problem(where, source.element.line, source.id, "is the tree with these actions")
        )
        raise FileError(problems)


def _declarations(spec: NodeSpec, found: TeamTree, team: TeamFile) -> dict[str, Declaration]:
    """The declarations of each action: of the team file, and the annotations at the node."""
    declared: dict[str, Declaration] = {}
    for place, _, node in walk(spec):
        if node.kind is not Kind.ACTION:
            continue
        known = declared.get(node.subject) or team.declaration(node.subject)
        known = annotated(known, found.annotations.get(place, {}), team)
        if known is not None:
            declared[node.subject] = known
    return declared


def _independent(spec: NodeSpec, found: TeamTree, named: Collection[str]) -> frozenset[str]:
    """The paths of the nodes whose children are independent."""
    nodes = list(walk(spec))
    chosen, unknown = set(), []
    for name in named:
        matching = [node.path for node in nodes if name in (node.path, node.spec.name)]
        chosen.update(matching)
        if not matching:
            known = [node.path for node in nodes if len(node.spec.children) > 1]
            message = f"no node has the path or name {name!r}{nearest(name, known)}"
            unknown.append(Problem("--assume-independent", 0, "", message))
    if unknown:
        raise FileError(unknown)
    for node in nodes:
        attributes = found.annotations.get(node.place, {})
        if read_boolean(attributes.get(INDEPENDENT, "false")):
            chosen.add(node.path)
    return frozenset(chosen)


def _mission_data(
    lifted: Lifted, team: TeamFile, name: str, same_robots: Templates
) -> dict[str, Any]:
    """The mission file: every action a global task that one robot carries out."""
    model = team.model
    data: dict[str, Any] = {"mission": model.mission or name}
    if model.program is not None:
        data["program"] = model.program
    if model.parameters:
        data["parameters"] = dict(model.parameters)
    actions = list(dict.fromkeys(map(type_name, _subjects(lifted.tree, Kind.ACTION))))
    data["local_tasks"] = {
        task: _only_given(
            {"parameters": list(given.parameters), **_tree_of(given), "work": given.work},
            {"parameters": [], "ports": {}},
        )
        for task, given in model.local_tasks.items()
    }
    conditions = _conditions(lifted.tree, team)
    if conditions:
        data["conditions"] = conditions
    given = model.model_dump(mode="json", exclude_unset=True)
    data |= {key: given[key] for key in ("robot_types", "robots")}
    data["global_tasks"] = {
        task: _global_task(task, team, same_robots.get(task)) for task in actions
    }
    data["tree"] = tree_data(lifted.tree)
    return data


def _tree_of(given: TeamTaskModel) -> dict[str, Any]:
    """The tree of a unit."""
    if not isinstance(given, UnitTaskModel):
        return {}
    return {"tree": given.tree, "ports": dict(given.ports)}


def _only_given(values: dict[str, Any], defaults: Mapping[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in values.items() if defaults.get(key) != value}


def _global_task(task: str, team: TeamFile, same_robot_as: str | None) -> dict[str, Any]:
    """psi = {alpha}, nu = mu = 1 (paper, section V-A)."""
    parameters = team.parameters(task) or []
    arguments = ", ".join(f"${name}" for name in parameters)
    call = f"{task}({arguments})" if parameters else task
    need: dict[str, Any] = {"min": 1, "max": 1}
    if same_robot_as is not None:
        need["same_robot_as"] = {"global_task": same_robot_as}
    needs = {"needs": {call: need}}
    return {"parameters": parameters, **needs} if parameters else needs


def _conditions(tree: NodeSpec, team: TeamFile) -> dict[str, Any]:
    """Those of the team file, and those that the tree asks and nobody has declared."""
    found: dict[str, Any] = {
        name: _only_given(
            {
                "parameters": list(given.parameters),
                "default": given.default,
                "per": given.per,
                "failure_reason": _reason(given.failure_reason),
            },
            {"parameters": [], "per": "team", "failure_reason": None},
        )
        for name, given in team.model.conditions.items()
    }
    for subject in _subjects(tree, Kind.CONDITION):
        name, arguments = split_call(subject)
        if name == ALWAYS:
            found.setdefault(name, {"default": True})
        elif arguments:
            parameters = [f"arg_{number + 1}" for number in range(len(arguments))]
            found.setdefault(name, {"parameters": parameters, "default": False})
        else:
            found.setdefault(name, {"default": False})
    return found


def _reason(given: FailureReasonModel | None) -> dict[str, str] | None:
    return None if given is None else given.model_dump(exclude_none=True)


def heading(tree: str, file: Path, team: Path, lifted: Lifted) -> str:
    """The comment at the beginning of the mission file."""
    return (
        f"The tree {tree} of {file.name}, lifted for the team of {team.name}.\n"
        f"One robot needs {lifted.serial_us / 1e6:g} s of work, a large team "
        f"{lifted.critical_us / 1e6:g} s if nothing fails."
    )
