"""The declarations in a team file of the leaves of a single robot's tree, and so of its units.

Local tasks of the team file are leaves here, by their types; their parameters are ports, by name
or, if no port has such a name, by position. A leaf that the file does not name is one that every
robot has a function for, and it declares nothing.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from mrbt_mesh.analysis.lift.annotations import annotated, annotated_names
from mrbt_mesh.analysis.lift.units import UNDECLARED, OwnUse
from mrbt_mesh.btcpp.files.builtin_nodes import BUILTIN, SWITCHES
from mrbt_mesh.btcpp.files.document import Category, pointer
from mrbt_mesh.btcpp.files.entries import access_below
from mrbt_mesh.btcpp.files.expand import ExpandedNode, ExpandedTree
from mrbt_mesh.btcpp.files.library import Library
from mrbt_mesh.core.mission.mission import MICRO, performance
from mrbt_mesh.core.mission.names import ARGUMENT_PATTERN, MAX_ARGUMENTS
from mrbt_mesh.formats.declaration import Declaration
from mrbt_mesh.formats.expand import call_text, split_template
from mrbt_mesh.formats.team_file import DECLARES, TeamFile, TeamTaskModel

_ARGUMENT = re.compile(ARGUMENT_PATTERN)
_CHAIN = frozenset({"Sequence", "AsyncSequence"})
DEFAULT_WORK_US = MICRO


@dataclass
class UnitTeam:
    """A team file, read for one tree."""

    team: TeamFile
    tree: ExpandedTree
    library: Library

    def __post_init__(self) -> None:
        found = access_below([self.tree.root], self.library)
        self._fixed = self.tree.constants.keys() - found.writes
        # Entries that leaves' ports read (names in scripts may be enums).
        pointed = {
            key
            for node in self.tree.root.walk()
            for name, value in node.ports.items()
            if not node.children and (key := pointer(value, name)) is not None
        }
        self.unwritten = pointed - found.writes - self.tree.constants.keys()
        self.types = {node.type for node in self.tree.root.walk() if not node.children}

    # -- leaves -----------------------------------------------------------------------------------

    def category(self, node: ExpandedNode) -> Category:
        """A leaf's category; conditions of the team file count as models."""
        is_condition = node.is_guessed and node.type in self.team.model.conditions
        return Category.CONDITION if is_condition else node.category

    def constants(self, node: ExpandedNode) -> dict[str, str | None]:
        """A leaf's ports; None for what is only known when it runs."""
        model = self.library.model(node.type)
        values = {port.name: port.default for port in model.ports.values()} if model else {}
        found: dict[str, str | None] = {}
        for name, value in {**values, **node.ports}.items():
            if value is None:
                continue
            key = pointer(value, name)
            if key is not None:
                value = self.tree.constants[key] if key in self._fixed else None
            found[name] = value
        return found

    def is_asked(self, node: ExpandedNode) -> bool:
        """Whether a node is a condition of the team, with arguments that are known."""
        declared = self.team.model.conditions.get(node.type)
        if declared is None or self.category(node) is not Category.CONDITION:
            return False
        values = list(self.constants(node).values())
        is_plain = all(value is not None and _ARGUMENT.fullmatch(value) for value in values)
        return declared.per == "team" and is_plain and len(values) == len(declared.parameters)

    def bound(self, node: ExpandedNode, task: TeamTaskModel) -> dict[str, str | None]:
        """A local task's parameters with the values of a leaf's ports."""
        ports = self.constants(node)
        names = task.parameters
        if not set(names) & ports.keys():
            return dict(zip(names, [*ports.values(), *[None] * len(names)], strict=False))
        return {name: ports.get(name) for name in names}

    def declaration(self, node: ExpandedNode) -> Declaration | None:
        """What one leaf declares; None if nothing, or of what is only known when it runs."""
        return annotated(self._declared(node), node.metadata, self.team)

    def _declared(self, node: ExpandedNode) -> Declaration | None:
        task = self.team.model.local_tasks.get(node.type)
        if task is None or not task.model_fields_set & set(DECLARES):
            return None
        if self.unknown_arguments(node):
            return None
        values = [value or "" for value in self.bound(node, task).values()]
        plain = [value if _ARGUMENT.fullmatch(value) else "_" for value in values]
        return self.team.declaration(call_text(node.type, plain))

    def unknown_arguments(self, node: ExpandedNode) -> list[str]:
        """Parameters on which it depends what a leaf does to the world, and that have no value yet.

        What is a robot's own stays in the unit, whatever its arguments are.
        """
        task = self.team.model.local_tasks.get(node.type)
        if task is None:
            return []
        bound = self.bound(node, task)
        texts = [text for key in DECLARES[:-1] for text in getattr(task, key)]
        calls = [split_template(text) for text in texts]
        used = {
            argument.removeprefix("$")
            for name, arguments in calls
            for argument in arguments
            if argument.startswith("$") and not self.team.belongs_to_robots(name)
        }
        return sorted(name for name in used if not _ARGUMENT.fullmatch(bound.get(name) or ""))

    def of_robots(self, node: ExpandedNode) -> Iterator[OwnUse]:
        """Conditions and resources with `per: robot` that a leaf has to do with.

        Arguments are not looked at, which may only be known when the leaf runs. A leaf that
        declares nothing may have to do with all of them.
        """
        if self.is_undeclared(node):
            may_change = self.category(node) is Category.ACTION
            for words in (*self.own_names().values(), UNDECLARED):
                yield OwnUse(words, is_declared=False, may_change=may_change)
            return
        names = list(annotated_names(node.metadata))
        if self.category(node) is Category.CONDITION:
            names.append(("reads", node.type, None))
        task = self.team.model.local_tasks.get(node.type)
        for key in DECLARES[:-1] if task else ():
            given = getattr(task, key)
            for text in given:
                value = given[text] if key == "effects" else None
                names.append((key, split_template(text)[0], value))
        own = [row for row in names if row[0] != "uses" and self.team.belongs_to_robots(row[1])]
        read = {name for key, name, _ in own if key in ("reads", "requires")}
        made = {name: value for key, name, value in own if key == "effects"}
        restored = {name for name, value in made.items() if value is self.team.default(name)}
        for name in dict.fromkeys(name for _, name, _ in own):
            yield OwnUse(self.own_names()[name], name in made.keys() - read, name in restored)
        for key, name, _ in names:
            resource = self.team.model.resources.get(name)
            if key == "uses" and resource is not None and resource.per == "robot":
                # With what the robot holds ends what is in its gripper.
                yield OwnUse(self.own_names()[name], bool(made) and not read, bool(restored))

    def own_names(self) -> dict[str, str]:
        """What each robot has for itself, in words."""
        model = self.team.model
        own = [
            ("condition", name) for name, each in model.conditions.items() if each.per == "robot"
        ]
        own += [("resource", name) for name, each in model.resources.items() if each.per == "robot"]
        return {name: f"the robot's own {kind} {name!r}" for kind, name in own}

    def is_undeclared(self, node: ExpandedNode) -> bool:
        """Whether a leaf of the program has no declarations."""
        if node.type in BUILTIN or self.is_asked(node):
            return False
        match self.category(node):
            case Category.ACTION:
                task = self.team.model.local_tasks.get(node.type)
                declares = task is not None and task.model_fields_set & set(DECLARES)
                return not declares and annotated(None, node.metadata, self.team) is None
            case Category.CONDITION:
                return node.type not in self.team.model.conditions
        return False

    # -- units ------------------------------------------------------------------------------------

    def actions(self, nodes: Sequence[ExpandedNode]) -> list[ExpandedNode]:
        """The program's actions in a unit, in order."""
        return [
            node
            for each in nodes
            for node in each.walk()
            if self.category(node) is Category.ACTION and node.type not in BUILTIN
        ]

    def leaves(self, nodes: Sequence[ExpandedNode]) -> list[str]:
        """The types of the program's leaves in a unit, each once."""
        kinds = (Category.ACTION, Category.CONDITION)
        found = (node for each in nodes for node in each.walk())
        types = [n.type for n in found if n.category in kinds and n.type not in BUILTIN]
        return list(dict.fromkeys(types))

    def work_us(self, nodes: Sequence[ExpandedNode]) -> int:
        """What a unit usually takes a robot of performance 1: of a Fallback its first child."""
        return max(1, sum(map(self._work, nodes)))

    def _work(self, node: ExpandedNode) -> int:
        if not node.children:
            msec = self.constants(node).get("msec") or ""
            if node.type == "Sleep":
                return int(msec) * 1_000 if msec.isdigit() else 0
            is_action = self.category(node) is Category.ACTION and node.type not in BUILTIN
            known = node.type in self.team.model.local_tasks
            return (self.team.work_us(node.type) if known else DEFAULT_WORK_US) if is_action else 0
        parts = [self._work(child) for child in node.children]
        if "Fallback" in node.type or node.type in ("RecoveryNode", "TryCatch"):
            return next((part for part in parts if part), 0)
        if node.type in ("IfThenElse", "WhileDoElse"):
            return parts[0] + max(parts[1:])
        if node.type in SWITCHES:
            return max(parts)
        return sum(parts)

    def performance(
        self, capabilities: Mapping[str, int], nodes: Sequence[ExpandedNode]
    ) -> tuple[float, list[str]]:
        """How well robots with these capabilities do a unit, and the leaves that they lack.

        The time for all is the sum of the times for each.
        """
        lacking, nominal, needed = [], 0.0, 0.0
        for node in self.actions(nodes):
            task = self.team.model.local_tasks.get(node.type)
            micro: int | None = MICRO
            if task is not None:
                values = [value or "_" for value in self.bound(node, task).values()]
                is_plain = all(map(_ARGUMENT.fullmatch, values)) and len(values) <= MAX_ARGUMENTS
                ground = call_text(node.type, values) if is_plain else node.type
                micro = performance(capabilities, ground)
            if not micro:
                lacking.append(node.type)
                continue
            nominal += self._work(node)
            needed += self._work(node) * MICRO / micro
        return (round(nominal / needed, 6) if needed else 1.0), list(dict.fromkeys(lacking))

    def unit_declaration(self, nodes: Sequence[ExpandedNode]) -> Declaration | None:
        """What a unit as a whole declares; None if one of its actions declares nothing.

        A chain of actions of which only the first can fail is as precise as one action; of others
        it is only said what they may read and change.
        """
        rows = [self.declaration(node) for node in self.actions(nodes)]
        found = [self._without_own(row) for row in rows if row is not None]
        if len(found) < len(rows):
            return None
        inner = [node for each in nodes for node in each.walk()]
        asked = frozenset(
            call_text(node.type, [value or "" for value in self.constants(node).values()])
            for node in inner
            if self.is_asked(node)
        )
        is_chain = all(
            (node.type in _CHAIN or node.category is Category.SUBTREE)
            if node.children
            else self.category(node) is Category.ACTION and node.type not in BUILTIN
            for node in inner
        )
        has_conditions = any(node.conditions for node in inner)
        chained = _chained(found) if is_chain and not has_conditions else None
        return chained or _blurred(found, asked)

    def _without_own(self, row: Declaration) -> Declaration:
        """What is a robot's own stays inside the unit."""
        own = self.team.belongs_to_robots
        return replace(
            row,
            reads=frozenset(name for name in row.reads if not own(name)),
            writes=frozenset(name for name in row.writes if not own(name)),
            requires={name: value for name, value in row.requires.items() if not own(name)},
            effects={name: value for name, value in row.effects.items() if not own(name)},
            may_fail=row.may_fail or any(map(own, row.requires)),
        )


def _chained(rows: Sequence[Declaration]) -> Declaration | None:
    """Actions one after the other as one; None if a later one can fail, or undoes what it needs."""
    requires: dict[str, bool] = {}
    effects: dict[str, bool] = {}
    writes: frozenset[str] = frozenset()
    for number, row in enumerate(rows):
        if number and row.may_fail:
            return None
        for name, value in row.requires.items():
            if name in effects:
                if effects[name] is not value:
                    return None
            elif number or name in writes:
                return None
            else:
                requires[name] = value
        effects = {k: v for k, v in effects.items() if k not in row.writes} | dict(row.effects)
        writes |= row.writes
    return Declaration(
        frozenset().union(*(row.reads for row in rows)),
        writes,
        frozenset().union(*(row.uses for row in rows)),
        requires,
        effects,
        any(row.may_fail for row in rows[:1]),
        sum(row.work for row in rows),
    )


def _blurred(rows: Sequence[Declaration], asked: frozenset[str]) -> Declaration:
    return Declaration(
        asked.union(*(row.all_reads for row in rows)),
        frozenset().union(*(row.all_writes for row in rows)),
        frozenset().union(*(row.uses for row in rows)),
        may_fail=True,
        work=sum(row.work for row in rows),
    )
