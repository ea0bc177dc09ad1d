"""Each global task in a run: its state, and the robots that took part."""

from __future__ import annotations

import enum
from dataclasses import dataclass, field

from mrbt_mesh.core.bt.activation import parse_activation
from mrbt_mesh.core.bt.tree import Kind, Status
from mrbt_mesh.core.facts.activation_facts import ActivationFacts
from mrbt_mesh.core.facts.records import TeamOrder
from mrbt_mesh.core.facts.store import Entry
from mrbt_mesh.core.facts.task_status import has_succeeded
from mrbt_mesh.core.facts.validation import ACTIVATION_KINDS
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.core.planning.plan import Plan


class TaskState(enum.StrEnum):
    """The state of a global task. CANCELLED: no longer requested, without a result."""

    IDLE = "idle"
    RUNNING = "running"
    SUCCESS = "success"
    FAILURE = "failure"
    CANCELLED = "cancelled"


@dataclass(slots=True)
class TaskRecord:
    """A global task: its state and the robots that ran one of its local tasks."""

    state: TaskState = TaskState.IDLE
    robots: set[str] = field(default_factory=set)


class TaskLog:
    """Follows the global tasks through facts and plans; those of jobs are in no log of tasks.

    A plan has the result of a task only as long as its node is reached. Once a condition takes it
    out of reach, the facts of its latest activation decide; they are kept here, since the team
    drops them then: those of the newest `limit` activations and of the latest of each task.
    """

    def __init__(self, mission: Mission, limit: int | None = None) -> None:
        self.tasks = {task: TaskRecord() for task in mission.global_tasks}
        self._mission = mission
        self._limit = limit
        self._said: dict[str, ActivationFacts] = {}
        self._latest: dict[str, ActivationFacts] = {}
        self._failed: set[str] = set()

    def revised(self, mission: Mission) -> None:
        """Another revision of the mission is in force: its tasks are told from now on."""
        before, self._mission = self.tasks, mission
        self.tasks = {task: before.get(task) or TaskRecord() for task in mission.global_tasks}

    def took_part(self, robot: str, activation: str) -> None:
        """The robot has run a local task of this activation."""
        task = self.tasks.get(parse_activation(activation).subject)
        if task is not None:
            task.robots.add(robot)

    def has_succeeded(self, task: str) -> bool:
        """Whether the task is one of the mission, and has succeeded."""
        known = self.tasks.get(task)
        return known is not None and known.state is TaskState.SUCCESS

    def fact(self, entry: Entry) -> None:
        """An entry of the fact map has changed."""
        of_task = Kind.ACTION in ACTIVATION_KINDS.get(entry.parts[0], ())
        if of_task and not parse_activation(entry.parts[1]).job:
            self._known(entry.parts[1]).add(entry)

    def plan(self, plan: Plan) -> None:
        """A new plan: the state of every task that it shows, and of those out of reach."""
        evaluation = plan.evaluation
        requests = () if plan.command is TeamOrder.ABORT else evaluation.requests
        nodes = evaluation.tree.nodes
        requests = tuple(request for request in requests if not nodes[request.node].job)
        for request in requests:
            self._known(request.activation)
        self._failed.update(evaluation.failures)
        shown: dict[str, set[TaskState]] = {
            request.subject: {TaskState.RUNNING} for request in requests
        }
        for node in evaluation.tree.actions():
            status = evaluation.status_of(node.index)
            if status in (Status.SUCCESS, Status.FAILURE):
                shown.setdefault(node.subject, set()).add(TaskState[status.name])
        order = (TaskState.RUNNING, TaskState.FAILURE, TaskState.SUCCESS)
        for name, task in self.tasks.items():
            found = shown.get(name, ())
            task.state = next((state for state in order if state in found), self._ended(name))

    def _known(self, activation: str) -> ActivationFacts:
        said = self._said.get(activation)
        if said is None:
            said = self._said[activation] = ActivationFacts(parse_activation(activation))
            self._latest[said.activation.subject] = said
            if self._limit is not None and len(self._said) > self._limit:
                self._forget_oldest()
        return said

    def _forget_oldest(self) -> None:
        latest = self._latest
        old = (a for a, said in self._said.items() if latest[said.activation.subject] is not said)
        activation = next(old, None)
        if activation is not None:
            del self._said[activation]
            self._failed.discard(activation)

    def _ended(self, name: str) -> TaskState:
        """The state of a task that no node shows any more."""
        said = self._latest.get(name)
        if said is None:
            return self.tasks[name].state
        if has_succeeded(self._mission.global_tasks[name], said):
            return TaskState.SUCCESS
        is_failure = said.has_latched_failure or said.verdict is False
        is_failure = is_failure or str(said.activation) in self._failed
        return TaskState.FAILURE if is_failure else TaskState.CANCELLED
