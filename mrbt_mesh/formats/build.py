"""Build the core's ground `Mission` from a mission file, and check the file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from mrbt_mesh.core.bt.tree import Kind, Tree, TreeError, build_tree
from mrbt_mesh.core.feature import Built, JointPolicy, PerformanceRule, features
from mrbt_mesh.core.mission.mission import (
    MAX_AT_MOST,
    MAX_GLOBAL_TASKS,
    Costs,
    FailurePolicy,
    GlobalTask,
    JobType,
    LocalTask,
    Mission,
    MissionEnd,
    Need,
    Recorded,
    Robot,
    SameRobotAs,
)
from mrbt_mesh.core.mission.names import entries_in
from mrbt_mesh.errors import nearest
from mrbt_mesh.formats.blackboard import BlackboardEntries
from mrbt_mesh.formats.expand import (
    Calls,
    Declared,
    Expander,
    JobTree,
    Placeholder,
    Scope,
    Template,
    TooManyNodesError,
    call_text,
    check_call,
    check_template,
    check_templates,
    ground_call,
    micro_or_report,
    read_template,
    split_template,
)
from mrbt_mesh.formats.failure_reasons import condition_types
from mrbt_mesh.formats.jobs import JobTypes
from mrbt_mesh.formats.mission_model import (
    Blocked,
    FailAfterModel,
    FailurePolicyModel,
    GlobalTaskModel,
    MissionModel,
    NeedModel,
    RobotModel,
    SameRobotModel,
    validate,
)
from mrbt_mesh.formats.problems import Report, SourcePath
from mrbt_mesh.formats.program_trees import ProgramTrees
from mrbt_mesh.formats.travel import TravelBuilder
from mrbt_mesh.formats.yaml_source import read_yaml


def mission_from_yaml(text: str, file: str, folder: Path) -> Mission:
    """Return the mission in `text`; `file` is for messages, `program` is relative to `folder`.

    Raises FileError with all problems that could be found.
    """
    data, report = read_yaml(text, file)
    model = validate(data, report)
    if model is None:
        report.raise_if_any()
        raise AssertionError("a refused mission has problems")
    return _Builder(model, report).build(folder)


def resolve_program(reference: str | None, folder: Path) -> str | None:
    """Return `robot.py:name`, relative to `folder`, with an absolute path. None stays None."""
    if reference is None:
        return None
    path, separator, name = reference.rpartition(":")
    if not separator or not path.endswith(".py"):
        path, separator, name = reference, "", ""
    return f"{(folder / path).resolve()}{separator}{name}"


class _Builder:
    def __init__(self, model: MissionModel, report: Report) -> None:
        self.model = model
        self.report = report
        self.local_parameters = {n: t.parameters for n, t in model.local_tasks.items()}
        self.blackboard = BlackboardEntries(model, report)
        self.parameters = {**self.blackboard.elsewhere, **model.parameters}
        self.globals = frozenset(self.parameters)
        self.tasks = 0
        self.program_trees = ProgramTrees(model, report)
        self.travel = TravelBuilder(model, report)
        self.jobs = JobTypes(model, self.travel.places, report)

    def build(self, folder: Path) -> Mission:
        model = self.model
        self.check_parameter_lists()
        types = self.robot_types()
        robots = self.robots(types)
        local_tasks = {
            name: LocalTask(
                name,
                tuple(task.parameters),
                micro_or_report(task.work, ("local_tasks", name, "work"), self.report),
            )
            for name, task in sorted(model.local_tasks.items())
        }
        self.check_global_tasks()
        self.check_effects()
        conditions = condition_types(model, self.report) | self.blackboard.types
        template, subtrees, job_trees = self.templates()
        # Problems found so far would be found again for every value.
        self.report.raise_if_any()
        at_most = min(MAX_AT_MOST, 2 * len(model.robots))
        parameters = {**self.blackboard.arguments, **model.parameters}
        expander = Expander(subtrees, parameters, self.report, job_trees, at_most, self.blackboard)
        tree = self.tree(expander, template)
        if tree is not None:
            self.jobs.check_nodes(tree, job_trees)
        needed: dict[str, list[str]] = {}
        global_tasks = self.ground_tasks(expander.global_calls, needed)
        jobs = {
            name: self.job_type(self.jobs[name], job_tree.calls, needed, folder)
            for name, job_tree in job_trees.items()
        }
        if tree is not None:
            self.check_same_robots(tree, global_tasks, expander, jobs)
        needed = dict(sorted(needed.items()))
        program_trees = self.program_trees.ground(needed, folder)
        travel = self.travel.build(robots, needed, jobs.values())
        built = Built(types, self.local_parameters, global_tasks.keys(), jobs)
        sections = {each.section: each.build(model, built, self.report) for each in features()}
        self.report.raise_if_any()
        assert tree is not None
        return Mission(
            name=model.mission,
            robots=robots,
            robot_types=types,
            local_tasks=local_tasks,
            conditions=conditions,
            global_tasks=global_tasks,
            tree=tree,
            parameters=_sorted_deeply(model.parameters),
            program=resolve_program(model.program, folder),
            solver=model.solver,
            ends=MissionEnd(model.ends),
            recorded=Recorded(model.recorded),
            program_trees=program_trees,
            travel=travel,
            jobs=jobs,
            sections={name: found for name, found in sections.items() if found},
            costs=Costs(
                {n: t.cost for n, t in sorted(model.robot_types.items()) if t.cost != 1},
                {n: t.cost for n, t in sorted(model.local_tasks.items()) if t.cost != 1},
            ),
        )

    def check_parameter_lists(self) -> None:
        sections: dict[str, Mapping[str, Any]] = {
            "local_tasks": self.model.local_tasks,
            "conditions": self.model.conditions,
            "blackboard": self.model.blackboard,
            "global_tasks": self.model.global_tasks,
            "subtrees": self.model.subtrees,
        }
        for section, entries in sections.items():
            for name, entry in entries.items():
                seen: set[str] = set()
                for i, parameter in enumerate(entry.parameters):
                    if parameter in seen:
                        place = (section, name, "parameters", i)
                        self.report.add(place, f"parameter {parameter!r} is named twice")
                    seen.add(parameter)

    def robot_types(self) -> dict[str, dict[str, int]]:
        types = {}
        for name, entry in sorted(self.model.robot_types.items()):
            path = ("robot_types", name, "capabilities")
            types[name] = dict(sorted(self.capabilities(entry.capabilities, path).items()))
        return types

    def capabilities(self, given: Mapping[str, float | None], path: SourcePath) -> dict[str, int]:
        """Return performances in micro-units by ground or type name; 0 for one taken away."""
        result: dict[str, int] = {}
        for text, value in given.items():
            here = (*path, text)
            name, arguments = split_template(text)
            ground = call_text(name, arguments)
            if name not in self.local_parameters:
                hint = nearest(name, self.local_parameters)
                message = f"unknown capability {ground!r}: no local task is called {name!r}{hint}"
                self.report.add(here, message)
            elif arguments:
                check_call(
                    text, "local task", self.local_parameters, frozenset(), here, self.report
                )
            if ground in result:
                self.report.add(here, f"capability {ground!r} is given twice; keep one")
            result[ground] = 0 if value is None else micro_or_report(value, here, self.report)
        return result

    def robots(self, types: Mapping[str, Mapping[str, int]]) -> dict[str, Robot]:
        robots = {}
        for robot_id, entry in sorted(self.model.robots.items()):
            path: SourcePath = ("robots", robot_id)
            own: dict[str, int] = {}
            if isinstance(entry, RobotModel):
                own = self.capabilities(entry.capabilities, (*path, "capabilities"))
                type_path, type_name = (*path, "type"), entry.type
            else:
                type_path, type_name = path, entry
            if type_name not in types:
                hint = nearest(type_name, types)
                self.report.add(type_path, f"unknown robot type {type_name!r}{hint}")
                continue
            merged = dict(types[type_name]) | own
            for ground, value in own.items():
                if value == 0 and ground not in types[type_name]:
                    text = f"type {type_name!r} has no capability {ground!r} to take away"
                    hint = nearest(ground, types[type_name])
                    self.report.add((*path, "capabilities", ground), text + hint)
            able = {ground: value for ground, value in sorted(merged.items()) if value}
            robots[robot_id] = Robot(robot_id, type_name, able)
        return robots

    def check_global_tasks(self) -> None:
        for name, task in self.model.global_tasks.items():
            scope = self.globals | set(task.parameters)
            if not any(need.min for need in task.needs.values()):
                text = (
                    f"{name} would succeed at once: give one of its needs a min (nu) of at least 1"
                )
                self.report.add(("global_tasks", name, "needs"), text)
            for text, need in task.needs.items():
                path: SourcePath = ("global_tasks", name, "needs", text)
                check_call(text, "local task", self.local_parameters, scope, path, self.report)
                if need.same_robot_as is not None:
                    self.check_same_robot(need.same_robot_as, scope, (*path, "same_robot_as"))
                if need.max is None and need.min == 0:
                    text = "min (nu) is 0: give max (mu), the number of robots that may help"
                    self.report.add(path, text)
                if need.max is not None and need.min > need.max:
                    message = f"min (nu) is {need.min}, but max (mu) is {need.max}"
                    self.report.add(path, f"{message}; max has to be at least min")
                self.performance_rule(need, "", path)
            self.blocked_us(task.blocked, ("global_tasks", name, "blocked", "fail_after_s"))
            self.failure(task, ("global_tasks", name, "failure", "after_s"))
            self.joint(task, ("global_tasks", name))
        self.blocked_us(self.model.blocked, ("blocked", "fail_after_s"))

    def blocked_us(self, blocked: Blocked | None, path: SourcePath) -> int | None:
        """Return after how long a blocked task fails; None if it waits."""
        if not isinstance(blocked, FailAfterModel):
            return None
        return micro_or_report(blocked.fail_after_s, path, self.report)

    def joint(self, task: GlobalTaskModel, path: SourcePath) -> JointPolicy | None:
        """Return how robots carry the task out jointly; None: they do not."""
        found = (feature.build_joint(task, path, self.report) for feature in features())
        return next((policy for policy in found if policy is not None), None)

    def failure(self, task: GlobalTaskModel, path: SourcePath) -> tuple[FailurePolicy, int | None]:
        """Return the policy, and for how long the team has to agree; None: the default time."""
        if not isinstance(task.failure, FailurePolicyModel):
            return FailurePolicy(task.failure), None
        after_us = micro_or_report(task.failure.after_s, path, self.report)
        return FailurePolicy(task.failure.policy), after_us

    def check_same_robot(
        self, same: SameRobotModel, scope: frozenset[str], path: SourcePath
    ) -> None:
        tasks = {name: task.parameters for name, task in self.model.global_tasks.items()}
        here = (*path, "global_task")
        check_call(same.global_task, "global task", tasks, scope, here, self.report)
        if same.local_task is not None:
            here = (*path, "local_task")
            parameters = self.local_parameters
            check_call(same.local_task, "local task", parameters, scope, here, self.report)

    def templates(
        self,
    ) -> tuple[Template, dict[str, tuple[Sequence[str], Template]], dict[str, JobTree]]:
        """Return the templates of the tree, of all subtrees, and of all job types, checked."""
        model, report = self.model, self.report
        declared = Declared(
            {name: task.parameters for name, task in model.global_tasks.items()},
            {name: entry.parameters for name, entry in model.conditions.items()},
            {name: entry.parameters for name, entry in model.subtrees.items()},
            jobs=model.jobs,
            comparisons=self.blackboard,
        )
        trees = {n: (entry.tree, ("subtrees", n, "tree")) for n, entry in model.subtrees.items()}
        template = read_template(model.tree, ("tree",), report)
        check_template(template, declared, self.globals, report)
        subtrees = check_templates(trees, declared, self.parameters, report)
        return template, subtrees, self.jobs.templates(replace(declared, jobs=None))

    def tree(self, expander: Expander, template: Template) -> Tree | None:
        """Return the ground tree, or None after a problem."""
        try:
            spec = expander.expand(template, expander.parameters)
            return None if spec is None else build_tree(spec)
        except TooManyNodesError:
            return None
        except TreeError as error:
            self.report.add(("tree",), str(error))
            return None

    def ground_tasks(self, calls: Calls, needed: dict[str, list[str]]) -> dict[str, GlobalTask]:
        """Return the called tasks. The local tasks that they need are added to `needed`."""
        tasks: dict[str, GlobalTask] = {}
        for ground, (name, arguments, path) in calls.items():
            self.tasks += 1
            if self.tasks > MAX_GLOBAL_TASKS:
                self.report.add(path, f"more than {MAX_GLOBAL_TASKS} global tasks once expanded")
                break
            model = self.model.global_tasks[name]
            bound = dict(zip(model.parameters, arguments, strict=True))
            scope = {**self.parameters, **bound}
            failure, after_us = self.failure(model, path)
            blocked = self.model.blocked if model.blocked is None else model.blocked
            tasks[ground] = GlobalTask(
                ground,
                self.needs(ground, name, model, scope, needed),
                failure,
                self.blocked_us(blocked, path),
                model.preemptive,
                self.joint(model, path),
                after_us,
                self.effects(model, scope),
            )
        return tasks

    def job_type(
        self, known: JobType, calls: Calls, needed: dict[str, list[str]], folder: Path
    ) -> JobType:
        """Complete a job type with its tasks, places and trees.

        Local tasks without placeholders are added to `needed`.
        """
        local_calls: dict[str, list[str]] = {}
        tasks = self.ground_tasks(calls, local_calls)
        for local, arguments in sorted(local_calls.items()):
            del local_calls[local]
            of_job = any(isinstance(argument, Placeholder) for argument in arguments)
            (local_calls if of_job else needed)[local] = arguments
        return replace(
            known,
            global_tasks=tasks,
            at=self.travel.of_job(known, local_calls),
            program_trees=self.program_trees.ground(local_calls, folder),
        )

    def needs(
        self,
        ground: str,
        name: str,
        model: GlobalTaskModel,
        scope: Scope,
        needed: dict[str, list[str]],
    ) -> tuple[Need, ...]:
        needs: dict[str, Need] = {}
        for text, need in model.needs.items():
            path: SourcePath = ("global_tasks", name, "needs", text)
            try:
                local, arguments = ground_call(text, scope)
            except ValueError as error:
                self.report.add(path, f"in {ground}: {error}")
                continue
            if local in needs:
                self.report.add(path, f"{ground} needs {local} twice; keep one")
            most = need.min if need.max is None else need.max
            same = None
            try:
                if need.same_robot_as is not None:
                    same = self.same_robot(need.same_robot_as, scope, (*path, "same_robot_as"))
            except ValueError as error:
                self.report.add(path, f"in {ground}: {error}")
            rule = self.performance_rule(need, local, path)
            needs[local] = Need(local, need.min, most, same, rule)
            needed[local] = arguments
        return tuple(needs.values())

    def performance_rule(
        self, need: NeedModel, local_task: str, path: SourcePath
    ) -> PerformanceRule | None:
        """The rule of the feature that has one for this need."""
        given = (each.performance_rule(need, local_task, path, self.report) for each in features())
        return next(filter(None, given), None)

    def check_effects(self) -> None:
        conditions = {name: list(each.parameters) for name, each in self.model.conditions.items()}
        for name, task in self.model.local_tasks.items():
            scope = frozenset(task.parameters)
            for text in task.effects:
                path: SourcePath = ("local_tasks", name, "effects", text)
                check_call(text, "condition", conditions, scope, path, self.report)
                known = self.model.conditions.get(split_template(text)[0])
                if known is not None and known.failure_reason is not None:
                    message = "this condition follows from a failure: no success sets it"
                    self.report.add(path, message)

    def effects(self, model: GlobalTaskModel, scope: Scope) -> tuple[tuple[str, bool], ...]:
        """Return the effects declared for the local tasks of a global task, ground."""
        found: dict[str, bool] = {}
        for text in model.needs:
            local = self.model.local_tasks[split_template(text)[0]]
            try:
                bound = dict(zip(local.parameters, ground_call(text, scope)[1], strict=True))
                effects = {ground_call(n, bound)[0]: value for n, value in local.effects.items()}
            except ValueError:
                continue  # `needs` has reported it
            found |= {name: value for name, value in effects.items() if not entries_in(name)}
        return tuple(sorted(found.items()))

    def same_robot(
        self, model: SameRobotModel, scope: Scope, path: SourcePath
    ) -> SameRobotAs | None:
        """Return what `same_robot_as` names, ground. Without a local task, it is the task's only
        one.
        """
        ground, arguments = ground_call(model.global_task, scope)
        local = model.local_task
        if local is None:
            known = self.model.global_tasks[split_template(model.global_task)[0]]
            if len(known.needs) != 1:
                text = f"{ground} needs {', '.join(known.needs)}: name one, as local_task"
                self.report.add(path, text)
                return None
            (local,) = known.needs
            scope = {**scope, **dict(zip(known.parameters, arguments, strict=True))}
        return SameRobotAs(ground, ground_call(local, scope)[0])

    def check_same_robots(
        self,
        tree: Tree,
        tasks: Mapping[str, GlobalTask],
        expander: Expander,
        jobs: Mapping[str, JobType],
    ) -> None:
        """Check that tasks named by same_robot_as come before in the tree, and need that local
        task.
        """

        def check(
            index: int, tasks: Mapping[str, GlobalTask], calls: Calls, seen: set[str]
        ) -> None:
            node = tree.nodes[index]
            if node.kind is Kind.ACTION and node.subject in tasks:
                name, _, path = calls[node.subject]
                self.check_seen(tasks[node.subject], tasks, seen, name, path)
                seen.add(node.subject)
            for child in node.children:
                if node.kind is Kind.JOBS:
                    # Nodes after the Jobs node do not rely on jobs.
                    name = tree.nodes[child].name
                    own = {**tasks, **jobs[name].global_tasks}
                    check(child, own, {**calls, **expander.jobs[name].calls}, set(seen))
                else:
                    check(child, tasks, calls, seen)

        check(0, tasks, expander.global_calls, set())

    def check_seen(
        self,
        task: GlobalTask,
        tasks: Mapping[str, GlobalTask],
        seen: set[str],
        name: str,
        path: SourcePath,
    ) -> None:
        """Run `check_same_robots` for one task; `seen` are the tasks that come before it."""
        for need in task.needs:
            before = need.same_robot_as
            if before is None:
                continue
            here = f"{task.id} needs a robot that did {before.global_task}"
            if before.global_task not in seen:
                self.report.add(path, f"{here}, which does not come before it in the tree")
            elif tasks[before.global_task].need(before.local_task) is None:
                place = ("global_tasks", name, "needs")
                text = f"{before.global_task} needs no {before.local_task}"
                self.report.add(place, f"same_robot_as: {text}")


def _sorted_deeply(value: Any) -> Any:
    """Sort mappings by their keys, so that reading and compiling give the same bytes."""
    if isinstance(value, dict):
        return {key: _sorted_deeply(value[key]) for key in sorted(value)}
    if isinstance(value, list):
        return [_sorted_deeply(item) for item in value]
    return value
