"""Facts from a file, for planning without a network: `mrbt plan --facts FILE`.

conditions: {broken(2): true}
blackboard: {found: red, battery@A1: 12.5} # values of entries
done: [remove_screws, remove_cover]        # global tasks that have succeeded
failed: [fix_hw(4)]                        # global tasks that have failed
outcomes:                                  # single results of local tasks
  - {robot: A1, global_task: diagnose_part(1), local_task: do_diagnosis(1), success: true}
running: {A2: diagnose_part(2)}            # what robots work on
bids: {fetch(1): {drive(1): {A1: -12.5}}}  # where performances are bid; null: it has no bid
lost: {B1: [use_soldering_iron]}           # minor faults
performances: {A2: {replace_hw: 0.5}}      # where they differ from the mission
command: pause
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, TypeAlias

from pydantic import Field

from mrbt_mesh.core.bt.activation import parse_activation
from mrbt_mesh.core.bt.evaluator import Evaluator
from mrbt_mesh.core.facts import records
from mrbt_mesh.core.facts.description import Description
from mrbt_mesh.core.facts.records import (
    Claim,
    Member,
    Phase,
    TeamOrder,
)
from mrbt_mesh.core.facts.store import Incarnation, Version, parse_entry
from mrbt_mesh.core.facts.team_facts import TeamFacts, capability
from mrbt_mesh.core.mission.mission import MAX_PERFORMANCE, MICRO, Mission, micro_performance
from mrbt_mesh.core.mission.names import declared_name, robot_condition
from mrbt_mesh.errors import nearest
from mrbt_mesh.features.bids.needs import BID, by_bid
from mrbt_mesh.features.exclusive.kinds import COALITION
from mrbt_mesh.features.exclusive.records import Coalition, CoalitionId, CoalitionMember
from mrbt_mesh.features.values.traits import traits_of
from mrbt_mesh.formats.file_model import FileModel, one_of, read_model
from mrbt_mesh.formats.problems import Report, SourcePath
from mrbt_mesh.formats.tree_model import Scalar
from mrbt_mesh.formats.yaml_source import read_mapping

ALIVE = Incarnation(1, "file")


MAX_BID = MAX_PERFORMANCE // MICRO
_Bid: TypeAlias = Annotated[
    float | None,
    one_of(
        f"a number from {-MAX_BID} to {MAX_BID}, or null, expected",
        lambda v: v is None or (type(v) in (int, float) and -MAX_BID <= v <= MAX_BID),
    ),
]
_Command: TypeAlias = Annotated[
    str, one_of(" or ".join(TeamOrder), lambda v: v in tuple(TeamOrder))
]


class _OutcomeModel(FileModel):
    robot: str
    global_task: str
    local_task: str
    success: bool


class _FactsModel(FileModel):
    conditions: dict[str, bool] = Field(default={})
    blackboard: dict[str, Scalar] = Field(default={})
    done: list[str] = Field(default=[])
    failed: list[str] = Field(default=[])
    outcomes: list[_OutcomeModel] = Field(default=[])
    running: dict[str, str] = Field(default={})
    bids: dict[str, dict[str, dict[str, _Bid]]] = Field(default={})
    lost: dict[str, list[str]] = Field(default={})
    performances: dict[str, dict[str, Any]] = Field(default={})
    command: _Command | None = None


def facts_from_file(mission: Mission, path: Path | None) -> TeamFacts:
    """Return the facts in `path`, as the mission's robots would have written them.

    Without a path they are the facts at the start. All robots of the mission are members; `ALIVE`
    is their incarnation. Raises FileError with file and line for everything that is wrong with the
    facts.
    """
    builder = _Builder(mission)
    if path is not None:
        builder.read(path)
    return builder.facts


class _Builder:
    """Writes a file's statements as the entries that robots would have written."""

    def __init__(self, mission: Mission) -> None:
        self.mission = mission
        self.facts = TeamFacts(mission, "file")
        self.evaluator = Evaluator(mission.tree)
        self._sequence = 0
        self._crews: dict[str, list[CoalitionMember]] = {}
        self._report = Report("", {})
        for robot in mission.robots.values():
            member = Member(robot.type, robot.capabilities, {}, False, "", "", 0)
            self._write_member(robot.id, member, ())

    def read(self, path: Path) -> None:
        data, self._report = read_mapping(path, "a mapping is expected")
        given = read_model(_FactsModel, data, self._report)
        self._performances(given.performances)
        self._lost(given.lost)
        # Before outcomes, since conditions decide which activation an outcome belongs to.
        self._conditions(given.conditions)
        self._blackboard(given.blackboard)
        self._note_turns()
        self._ended("done", given.done)
        self._ended("failed", given.failed)
        self._outcomes(given.outcomes)
        self._bids(given.bids)
        self._running(given.running)
        if given.command is not None:
            self._order(given.command)
        self._report.raise_if_any()

    # -- sections -------------------------------------------------------------------------

    def _conditions(self, conditions: Mapping[str, bool]) -> None:
        for name, holds in conditions.items():
            here = ("conditions", name)
            if self.mission.entries.is_own(name):
                robot = robot_condition(name, self._first)
                self._report.add(here, f"every robot has its own: say whose, as in {robot}")
            elif not self.mission.entries.can_be_set(name) or self.mission.entries.is_value(name):
                self._report.add(here, f"no condition{nearest(name, self.mission.truths)}")
            elif self.facts.condition(name) != holds:
                changes = self.facts.conditions.changes(name) + 1
                self._write(self._first, f"{records.CONDITION}/{name}", [holds, changes, 1])

    def _blackboard(self, values: Mapping[str, Any]) -> None:
        for name, given in values.items():
            here, mission = ("blackboard", name), self.mission
            declared = mission.conditions.get(declared_name(name))
            held = traits_of(declared).values if declared is not None else None
            if not mission.entries.can_be_set(name) or held is None:
                hint = nearest(name, mission.conditions.keys() - mission.truths.keys())
                whose = "; say whose, as in battery@A1" if mission.entries.is_own(name) else hint
                self._report.add(here, f"no blackboard entry{whose}")
                continue
            try:
                value = held.value(given)
            except ValueError as error:
                self._report.add(here, str(error))
                continue
            self._write(self._first, f"{records.CONDITION}/{name}", [value, 1, 1])

    def _note_turns(self) -> None:
        """Write how often guards have changed, as robots do."""
        while turned := self.facts.turned_guards():
            for name, changes in turned:
                value = changes.to_value()
                self._write(self._first, f"{records.EXPRESSION}/{name}", value)

    def _ended(self, section: str, tasks: list[str]) -> None:
        for index, task in enumerate(tasks):
            here = (section, index)
            for activation in self._activations(task) if self._is_task(here, task) else ():
                if section == "failed":
                    self._write(self._first, f"{records.LATCHED_FAILURE}/{activation}", True)
                    continue
                for need in self.mission.global_tasks[task].needs:
                    able = self._able(need.local_task)[: need.min_robots]
                    if len(able) < need.min_robots:
                        text = f"no {need.min_robots} robots can do {need.local_task}"
                        self._report.add(here, text)
                    for robot in able:
                        self._outcome(robot, activation, need.local_task, True)

    def _outcomes(self, outcomes: list[_OutcomeModel]) -> None:
        for index, row in enumerate(outcomes):
            here, task = ("outcomes", index), row.global_task
            if not self._is_robot(here, row.robot) or not self._is_task(here, task):
                continue
            needs = [need.local_task for need in self.mission.global_tasks[task].needs]
            if row.local_task not in needs:
                self._report.add(here, f"{task} needs no {row.local_task!r}{nearest('', needs)}")
                continue
            for activation in self._activations(task):
                self._outcome(row.robot, activation, row.local_task, row.success)

    def _bids(self, bids: Mapping[str, Mapping[str, Mapping[str, float | None]]]) -> None:
        for task, needs in bids.items():
            if not self._is_task(("bids", task), task):
                continue
            named = [n.local_task for n in self.mission.global_tasks[task].needs if by_bid(n)]
            for local_task, rows in needs.items():
                here = ("bids", task, local_task)
                if local_task not in named:
                    text = f"{task} has no bids for {local_task!r}{nearest(local_task, named)}"
                    self._report.add(here, text)
                    continue
                for robot, bid in rows.items():
                    value = None if bid is None else round(bid * MICRO)
                    known = self._is_robot((*here, robot), robot)
                    for activation in self._activations(task) if known else ():
                        self._write(robot, f"{BID}/{activation}/{local_task}", value)

    def _running(self, running: Mapping[str, str]) -> None:
        for robot, task in running.items():
            here = ("running", robot)
            if not self._is_robot(here, robot) or not self._is_task(here, task):
                continue
            member = self.facts.members[robot].member
            needs = self.mission.global_tasks[task].needs
            able = [n.local_task for n in needs if capability(member, n.local_task) is not None]
            activations = self._activations(task)
            if not able or not activations:
                self._report.add(here, f"{robot} can do nothing that {task} needs")
                continue
            self._run(robot, task, activations[0], able[0])
        for name, crew in self._crews.items():
            self._write(self._first, name, Coalition(tuple(crew)).to_value())

    def _run(self, robot: str, task: str, activation: str, local_task: str) -> None:
        """Write the robot's claim, and its start in a coalition with the other robots on the
        task.
        """
        token = self._token(task)
        claim = Claim(activation, task, local_task, Phase.RUNNING, self._sequence + 1, token)
        self._write(robot, records.CLAIM, claim.to_value())
        if token:
            member = CoalitionMember(robot, local_task, *ALIVE, self._sequence, claim.since)
            self._crews.setdefault(f"{COALITION}/{activation}/{token}", []).append(member)

    def _token(self, task: str) -> str:
        """Return the token of a task's only coalition in a file; empty for tasks without
        coalitions.
        """
        by_coalition = self.mission.global_tasks[task].joint is not None
        return str(CoalitionId(1, self._first, *ALIVE)) if by_coalition else ""

    def _lost(self, lost: Mapping[str, list[str]]) -> None:
        for robot, names in lost.items():
            if self._is_robot(("lost", robot), robot):
                self._write_member(robot, self.facts.members[robot].member, names)

    def _performances(self, performances: Mapping[str, Mapping[str, Any]]) -> None:
        for robot, rows in performances.items():
            if not self._is_robot(("performances", robot), robot):
                continue
            known = self.mission.robots[robot]
            described = Description(robot, known.type, known.capabilities, "", "", 0)
            for local_task, number in rows.items():
                try:
                    problem = described.perform(local_task, micro_performance(number))
                except ValueError as error:
                    problem = str(error)
                if problem is not None:
                    self._report.add(("performances", robot, local_task), problem)
            self._write(robot, records.MEMBER, described.member(is_leaving=False).to_value())

    # -- helpers --------------------------------------------------------------------------

    @property
    def _first(self) -> str:
        return min(self.mission.robots)

    def _able(self, local_task: str) -> list[str]:
        members = self.facts.members
        return [r for r in sorted(members) if capability(members[r][0], local_task) is not None]

    def _activations(self, task: str) -> list[str]:
        actions = [node for node in self.mission.tree.actions() if node.subject == task]
        return [str(self.evaluator.current_activation(node.index, self.facts)) for node in actions]

    def _outcome(self, robot: str, activation: str, local_task: str, success: bool) -> None:
        name = f"{records.OUTCOME}/{activation}/{local_task}"
        token = self._token(parse_activation(activation).subject)
        self._write(robot, f"{name}/{token}" if token else name, [success, None])

    def _write_member(self, robot: str, member: Member, lost: Iterable[str]) -> None:
        found = dict.fromkeys(lost, "given in the facts file")
        described = replace(member, lost={**member.lost, **found})
        self._write(robot, records.MEMBER, described.to_value())

    def _write(self, robot: str, name: str, value: Any) -> None:
        self._sequence += 1
        self.facts.map.merge([parse_entry(robot, name, Version(ALIVE, self._sequence), value)])

    def _order(self, order: str) -> None:
        name = records.ABORTED if order == TeamOrder.ABORT else records.PAUSED
        value = True if order == TeamOrder.ABORT else order
        version = Version(Incarnation(1, "file"), 0)
        entry = parse_entry(records.OPERATORS, name, version, [value, "", "", ""])
        self.facts.map.merge([entry])

    def _is_robot(self, path: SourcePath, value: str) -> bool:
        if value in self.mission.robots:
            return True
        self._report.add(path, f"no robot {value!r}{nearest(value, self.mission.robots)}")
        return False

    def _is_task(self, path: SourcePath, value: str) -> bool:
        if value in self.mission.global_tasks:
            return True
        hint = nearest(value, self.mission.global_tasks)
        self._report.add(path, f"no global task {value!r} in this mission{hint}")
        return False
