"""A mission from a single robot's tree whose units are local tasks with trees of their own."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

from mrbt_mesh.analysis.lift.mission import INDEPENDENT, LiftedMission, lifted_mission
from mrbt_mesh.analysis.lift.unit_tasks import UnitTasks
from mrbt_mesh.analysis.lift.unit_team import UnitTeam
from mrbt_mesh.analysis.lift.units import HandUnit, Knowledge, Piece, split
from mrbt_mesh.analysis.team_tree import translated
from mrbt_mesh.btcpp.files.document import Category, Document
from mrbt_mesh.btcpp.files.expand import ExpandedNode, ExpandedTree, expand
from mrbt_mesh.btcpp.files.library import Library
from mrbt_mesh.btcpp.scripts.values import read_boolean
from mrbt_mesh.core.mission.mission import MICRO
from mrbt_mesh.errors import FileError, Problem, nearest
from mrbt_mesh.formats.declaration import Declaration
from mrbt_mesh.formats.team_file import TeamFile, UnitTaskModel


@dataclass(frozen=True)
class UnitsByHand:
    """The units of a file: their names, and the nodes in each."""

    file: str
    units: Mapping[str, Collection[str]]


@dataclass(frozen=True)
class LiftedUnits:
    """The mission, the file with the units' trees, how the tree was split, and its tasks."""

    mission: LiftedMission
    document: Document
    split: Piece
    tasks: UnitTasks


def lift_units(
    library: Library,
    tree: str,
    team: TeamFile,
    independent: Collection[str],
    name: str,
    by_hand: UnitsByHand | None,
    file: str,
) -> LiftedUnits:
    """Lift the tree called `tree` in units; `file` is where their trees will be.

    Raises FileError for whatever does not fit, with its place.
    """
    expanded = expand(library, tree)
    check_subtrees(expanded)
    unit_team = UnitTeam(team, expanded, library)
    named = _by_hand(expanded, by_hand) if by_hand is not None else {}
    unmatched = _declare_independent(expanded, independent)
    apart = [n for n in expanded.root.walk() if read_boolean(n.metadata.get(INDEPENDENT, "0"))]
    knowledge = Knowledge(unit_team.is_asked, unit_team.of_robots, named, set(map(id, apart)))
    found = split(expanded, library, knowledge)
    if by_hand is not None:
        _check_apart(found, named, by_hand.file)
    tasks = UnitTasks(unit_team, named)
    between = ExpandedTree(tasks.team_tree(found), expanded.constants)
    translated_tree = translated(library, between, Category.ACTION, team.model.conditions)
    team_of_units = _team_of_units(tasks, unit_team, file)
    mission = lifted_mission(translated_tree, team_of_units, library.trees[tree], unmatched, name)
    notes = (*mission.notes, *_notes(tasks, unit_team))
    mission = LiftedMission(mission.data, mission.lifted, notes)
    return LiftedUnits(mission, tasks.document(file), found, tasks)


def check_subtrees(tree: ExpandedTree) -> None:
    """Nobody can carry out a SubTree that is in none of the files: raises FileError."""
    problems = [
        Problem(
            node.file,
            node.line,
            node.path,
            f"there is no tree {node.type!r}; name its file (--models) or its folder (--trees), or "
            f"make it an action of the program (--as-action {node.type!r})",
        )
        for node in tree.root.walk()
        if node.category is Category.SUBTREE and not node.children
    ]
    if problems:
        raise FileError(problems)


def _declare_independent(tree: ExpandedTree, names: Collection[str]) -> list[str]:
    """Mark the nodes that the user names; returns the names that no node has.

    A node is named as the command prints it, `Patrol/Sequence` or `Patrol/Sequence:5`, without the
    tree's ID, or by its own name.
    """
    found = set()
    for node in tree.root.walk():
        _, _, short = node.path.partition("/")
        known = {node.path, short, f"{node.path}:{node.line}"}
        known |= {node.name} if node.name != node.type else set()
        if known & set(names):
            node.metadata[INDEPENDENT] = "true"
            found |= known
    return [name for name in names if name not in found]


# -- by hand ----------------------------------------------------------------------------------


def _by_hand(tree: ExpandedTree, by_hand: UnitsByHand) -> dict[int, HandUnit]:
    """The unit of each node that is named, by the node's identity.

    A unit with one name is each node that is called so; with several, all of them together.
    """
    nodes = list(tree.root.walk())
    found: dict[int, HandUnit] = {}
    problems = []
    for unit, names in by_hand.units.items():
        for name in names:
            matching = [node for node in nodes if name in _names(node)]
            if not matching:
                known = {node.path if "/" in name else node.name for node in nodes}
                message = f"no node has the path or name {name!r}{nearest(name, known)}"
                problems.append(Problem(by_hand.file, 0, f"units/{unit}", message))
            for number, node in enumerate(matching):
                own = HandUnit(unit, number if len(names) == 1 else 0)
                other = found.setdefault(id(node), own)
                if other != own:
                    message = f"{node.path} is in the unit {other.name!r}, too"
                    problems.append(Problem(by_hand.file, 0, f"units/{unit}", message))
    if problems:
        raise FileError(problems)
    return found


def _names(node: ExpandedNode) -> tuple[str, ...]:
    return node.path, node.name, node.type, f"{node.path}:{node.line}"


def _check_apart(found: Piece, by_hand: Mapping[int, HandUnit], file: str) -> None:
    problems = []
    for unit in found.units():
        inside = (inner for node in unit.nodes for inner in node.walk())
        named = {by_hand[id(node)] for node in inside if id(node) in by_hand}
        if len(named) > 1:
            listed = " and ".join(repr(name) for name in sorted(each.name for each in named))
            message = f"{listed} cannot be separate units: {'; '.join(unit.reasons)}"
            problems.append(Problem(file, 0, "units", message))
    if problems:
        raise FileError(problems)


# -- the team that does units -----------------------------------------------------------------


def _team_of_units(tasks: UnitTasks, team: UnitTeam, file: str) -> TeamFile:
    """The team file with units for local tasks, and robots that are capable of them."""
    model = team.team.model
    local_tasks = {
        task.name: UnitTaskModel(
            parameters=list(task.parameters),
            work=team.work_us(task.nodes) / MICRO,
            tree=f"{file}#{task.tree}",
            ports=dict(task.ports),
        )
        for task in tasks.tasks.values()
    }
    kinds, robots = {}, {}
    for kind, given in model.robot_types.items():
        capabilities = _capabilities(tasks, team, team.team.capabilities_of_type(kind))
        kinds[kind] = given.model_copy(update={"capabilities": capabilities})
    for robot, entry in model.robots.items():
        if isinstance(entry, str) or not entry.capabilities:
            robots[robot] = entry
            continue
        own = _capabilities(tasks, team, team.team.capabilities_of(robot))
        of_type = kinds[entry.type].capabilities if entry.type in kinds else {}
        lost = dict.fromkeys(name for name in of_type if name not in own)
        robots[robot] = entry.model_copy(update={"capabilities": own | lost})
    changed = {"local_tasks": local_tasks, "robot_types": kinds, "robots": robots}
    declared: dict[str, Declaration] = {}
    for use in tasks.uses:
        declaration = team.unit_declaration(use.piece.nodes)
        if declaration is not None:
            declared[use.call] = declaration
    found = TeamFile(model.model_copy(update=changed), team.team.file, declared)
    _check_capable(tasks, team, found)
    return found


def _capabilities(
    tasks: UnitTasks, team: UnitTeam, capabilities: Mapping[str, int]
) -> dict[str, float]:
    """The units that a robot can do, by type where all calls of one are alike."""
    found: dict[str, dict[str, float]] = {}
    calls: dict[str, set[str]] = {}
    for use in tasks.uses:
        well, lacking = team.performance(capabilities, use.piece.nodes)
        calls.setdefault(use.task.name, set()).add(use.call)
        if not lacking:
            found.setdefault(use.task.name, {})[use.call] = well
    result: dict[str, float] = {}
    for name, rows in found.items():
        is_alike = len(set(rows.values())) == 1 and rows.keys() == calls[name]
        result |= {name: next(iter(rows.values()))} if is_alike else rows
    return result


def _check_capable(tasks: UnitTasks, team: UnitTeam, units: TeamFile) -> None:
    problems = []
    for use in tasks.uses:
        if units.capable(use.call):
            continue
        rows = []
        for robot in team.team.model.robots:
            _, lacking = team.performance(team.team.capabilities_of(robot), use.piece.nodes)
            rows.append(f"{robot} lacks {', '.join(lacking)}")
        first = use.piece.nodes[0]
        why = f" ({'; '.join(use.piece.reasons)})" if use.piece.reasons else ""
        message = f"no robot can do all of the unit {use.call}: {'; '.join(rows[:8])}{why}"
        problems.append(Problem(first.file, first.line, first.path, message))
    if problems:
        raise FileError(problems)


def _notes(tasks: UnitTasks, team: UnitTeam) -> list[Problem]:
    """What the user may not have meant."""
    notes = []
    file, known = team.team.file, team.team.model.local_tasks
    for entry, reader in tasks.lacking.items():
        message = f"{reader} reads it and nothing in the tree writes it; give it a value here, "
        message += f"or have the program provide it: @robot.entry({entry!r})"
        notes.append(Problem(file, 0, f"parameters/{entry}", message))
    actions = {n.type: n for use in tasks.uses for n in team.actions(use.piece.nodes)}
    unnamed = [name for name in actions if name not in known]
    if unnamed and known:
        listed = ", ".join(f"{name}{_meant(name, known)}" for name in unnamed)
        message = f"not named, so every robot is taken to have them: {listed}"
        notes.append(Problem(file, 0, "local_tasks", message))
    for name, node in actions.items():
        for argument in team.unknown_arguments(node):
            message = f"{name} declares something of ${argument}, which no task's argument can be"
            text = f"{message} here: nothing is taken to be known of what it does"
            notes.append(Problem(node.file, node.line, node.path, text))
    return notes


def _meant(name: str, known: Collection[str]) -> str:
    text = nearest(name, known)
    return f" ({text.removeprefix('; ')})" if "did you mean" in text else ""
