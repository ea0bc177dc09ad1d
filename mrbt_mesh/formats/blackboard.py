"""`blackboard` of a mission file: entries with typed values, and what trees read of them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mrbt_mesh.core.mission.conditions import MAX_UNITS, ConditionType
from mrbt_mesh.core.mission.names import (
    THIS_JOB,
    declared_name,
    job_entry,
    placeholder,
    robot_condition,
    split_owner,
)
from mrbt_mesh.errors import nearest
from mrbt_mesh.formats.expand import (
    EntryArgument,
    Placeholder,
    Scope,
    argument_text,
    check_call,
    check_references,
    ground_call,
    split_template,
    substitute,
)
from mrbt_mesh.formats.listed_values import listed_values
from mrbt_mesh.formats.mission_model import EntryModel, MissionModel
from mrbt_mesh.formats.problems import Report, SourcePath
from mrbt_mesh.formats.tree_model import split_comparison

if TYPE_CHECKING:
    from mrbt_mesh.features.values.traits import Traits


def _traits_of(known: ConditionType) -> Traits:
    # Loaded here, as by all below: only for missions with a blackboard.
    from mrbt_mesh.features.values.traits import traits_of

    return traits_of(known)


class BlackboardEntries:
    """The blackboard entries of a mission, by name; problems go to the report.

    `arguments` holds what calls of tasks in the team's tree have in place of each entry until it is
    read; `elsewhere` holds what other calls have there, so that they are refused.
    """

    def __init__(self, model: MissionModel, report: Report) -> None:
        self._model = model
        self._report = report
        self._parameters = {name: each.parameters for name, each in model.blackboard.items()}
        self.types = {
            name: self._type(name, each) for name, each in sorted(model.blackboard.items())
        }
        for name in sorted({*model.blackboard} & {*model.conditions, *model.parameters}):
            report.add(("blackboard", name), f"{name} is declared twice; choose another name")
        set_somewhere = {
            split_template(each)[0]
            for task in model.local_tasks.values()
            for each in (*task.sets, *task.outputs.values())
        }
        self.arguments = {
            name: EntryArgument(
                name, self._unreadable(known, set_somewhere), _traits_of(known).per_job
            )
            for name, known in self.types.items()
        }
        hint = "pass it from the tree, as a parameter of the global task"
        self.elsewhere = {
            name: EntryArgument(name, f"${name} of the blackboard cannot be read here; {hint}")
            for name in self.types
        }
        for name, task in model.local_tasks.items():
            for i, each in enumerate(task.sets):
                if each not in self.types:
                    message = f"{each!r} is not a blackboard entry{nearest(each, self.types)}"
                    report.add(("local_tasks", name, "sets", i), message)

    def _unreadable(self, known: ConditionType, set_somewhere: set[str]) -> str:
        """Return why an entry cannot be an argument; empty if it can."""
        if _traits_of(known).per_robot:
            return f"every robot has its own {known.name}, so it cannot be an argument"
        if known.parameters:
            return f"{known.name} has parameters, so it cannot be an argument"
        if known.default is None and known.name not in set_somewhere:
            remedy = "give it a default, or name it in sets of the local task that sets it"
            return f"nothing sets {known.name}, so the task would wait for ever; {remedy}"
        return ""

    def _type(self, name: str, entry: EntryModel) -> ConditionType:
        from mrbt_mesh.features.values.blackboard import ValueType
        from mrbt_mesh.features.values.traits import Traits

        path: SourcePath = ("blackboard", name)
        low, high = entry.min, entry.max
        if entry.values is not None:
            place = (*path, "values")
            values = ValueType(listed_values(entry.values, self._model, place, self._report))
        elif entry.text is not None:
            values = ValueType(longest=entry.text)
        else:
            assert low is not None
            assert high is not None
            units = [self._units(n, entry.decimals, path) for n in (low, high)]
            values = ValueType(low=units[0], high=units[1], decimals=entry.decimals)
            if low > high:
                self._report.add(path, f"min is {low}, but max is {high}")
        default = None
        if entry.default is not None:
            try:
                default = values.value(entry.default)
            except ValueError as error:
                self._report.add((*path, "default"), str(error))
        traits = Traits(entry.per == "robot", values, entry.per == "job")
        return ConditionType(name, tuple(entry.parameters), default, traits=traits)

    def _units(self, number: float, decimals: int, path: SourcePath) -> int:
        from mrbt_mesh.features.values.blackboard import ValueType

        try:
            return int(ValueType(low=-MAX_UNITS, high=MAX_UNITS, decimals=decimals).value(number))
        except ValueError:
            self._report.add(path, f"a number with at most {decimals} decimals is expected")
            return 0

    # -- comparisons --------------------------------------------------------------------------

    def checks(self, text: str, scope: frozenset[str], path: SourcePath) -> bool:
        """Check a condition of a tree if it reads an entry. Returns whether it does."""
        parts = split_comparison(text)
        if parts is None:
            name = split_template(text)[0]
            if name in self.types:
                message = f"{name} is a blackboard entry; compare it"
                self._report.add(path, f"{message}, e.g. {name} {self._example(name)}")
            return name in self.types
        entry, robot = split_owner(parts[0])
        name = split_template(entry)[0]
        if name in self._model.conditions:
            message = f"{name} is a condition, which is true or false"
            self._report.add(path, f"{message}; write {{Condition: {entry}}}, or invert it")
            return True
        check_call(entry, "blackboard entry", self._parameters, scope, path, self._report)
        check_references(parts[2], scope, path, self._report)
        known = self.types.get(name)
        if robot and known is not None and not _traits_of(known).per_robot:
            message = f"{name} is not of each robot; leave out @{robot}"
            self._report.add(path, f"{message}, or declare it with per: robot")
        elif robot and robot not in self._model.robots:
            hint = nearest(robot, self._model.robots)
            self._report.add(path, f"there is no robot {robot!r}{hint}")
        return True

    def _example(self, name: str) -> str:
        values = _traits_of(self.types[name]).values
        assert values is not None
        if values.is_number:
            return f">= {values.text(values.low)}"
        return f"== {(*values.choices, 'text')[0]}"

    def ground(self, text: str, scope: Scope, is_in_job: bool) -> str:
        """Return a checked comparison of a tree, ground. Raises ValueError for an invalid one."""
        parts = split_comparison(text)
        assert parts is not None
        template, robot = split_owner(parts[0])
        entry, arguments = ground_call(template, scope)
        from mrbt_mesh.features.values.blackboard import EQUALITY

        known = self.types[declared_name(entry)]
        traits = _traits_of(known)
        values = traits.values
        literal = argument_text(substitute(parts[2], scope))
        if any(isinstance(each, EntryArgument) for each in (*arguments, literal)):
            raise ValueError("a blackboard entry is compared with a value, not with another entry")
        assert values is not None
        if parts[1] not in EQUALITY and not values.is_number:
            raise ValueError(f"{known.name} has no order: compare it with == or !=")
        if isinstance(literal, Placeholder) and not literal.ends:
            raise ValueError(f"{literal}: compare with a parameter of the job alone")
        try:
            of_job = literal.ends if isinstance(literal, Placeholder) else (literal,)
            texts = [values.text(values.value(each)) for each in of_job]
        except ValueError as error:
            raise ValueError(f"{known.name}: {error}") from None
        literal = literal if isinstance(literal, Placeholder) else texts[0]
        if traits.per_job and not is_in_job:
            raise ValueError(
                f"each job has its own {known.name}: only the tree of a job can read it"
            )
        if traits.per_job:
            entry = job_entry(entry, placeholder(THIS_JOB))
        elif robot:
            entry = robot_condition(entry, robot)
        return f"{entry} {parts[1]} {literal}"
