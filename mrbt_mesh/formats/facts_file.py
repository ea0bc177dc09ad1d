"""Facts from a file, for planning without a network: `mrbt plan --facts FILE`.

conditions: {broken(2): true}
done: [remove_screws, remove_cover]        # global tasks that have succeeded
failed: [fix_hw(4)]                        # global tasks that have failed
outcomes:                                  # single results of local tasks
  - {robot: A1, global_task: diagnose_part(1), local_task: do_diagnosis(1), success: true}
running: {A2: diagnose_part(2)}            # what robots work on
bids: {fetch(1): {drive(1): {A1: -12.5}}}  # where performances are bid; null: it has no bid
lost: {B1: [use_soldering_iron]}           # minor faults
performances: {A2: {replace_hw: 0.5}}      # where they differ from the mission
order: pause
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

from mrbt_mesh.core.bt.activation import parse_activation
from mrbt_mesh.core.bt.evaluator import Evaluator
from mrbt_mesh.core.facts import records
from mrbt_mesh.core.facts.description import Description
from mrbt_mesh.core.facts.records import (
    Claim,
    Coalition,
    CoalitionId,
    CoalitionMember,
    Member,
    OrderKind,
    Phase,
)
from mrbt_mesh.core.facts.store import Incarnation, Version, parse_entry
from mrbt_mesh.core.facts.team_facts import TeamFacts, capability
from mrbt_mesh.core.mission.mission import MAX_PERFORMANCE, MICRO, Mission, micro_performance
from mrbt_mesh.core.mission.names import robot_condition
from mrbt_mesh.errors import nearest
from mrbt_mesh.formats.problems import Report, SourcePath, found

_OUTCOME_KEYS = frozenset({"robot", "global_task", "local_task", "success"})
ALIVE = Incarnation(1, "file")


def facts_from_file(mission: Mission, path: Path | None) -> TeamFacts:
    """The facts in `path`, as the mission's robots would have written them; None: at the start.

    All robots of the mission are members; `ALIVE` is their incarnation. Raises FileError with
    file and line for whatever is wrong with the facts.
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
        from mrbt_mesh.formats.yaml_source import read_mapping

        data, self._report = read_mapping(path, "a mapping is expected")
        sections: dict[str, Callable[[SourcePath, Any], None]] = {
            "performances": self._performances,
            "lost": self._lost,
            "conditions": self._conditions,
            "done": lambda path, value: self._ended(path, value, success=True),
            "failed": lambda path, value: self._ended(path, value, success=False),
            "outcomes": self._outcomes,
            "bids": self._bids,
            "running": self._running,
            "order": self._order,
        }
        for key in data:
            if key not in sections:
                self._report.add((key,), f"unknown key{nearest(key, sections)}")
        # In this order, since conditions decide which activation an outcome belongs to.
        for key, take in sections.items():
            if key in data:
                take((key,), data[key])
        self._report.raise_if_any()

    # -- sections -------------------------------------------------------------------------

    def _conditions(self, path: SourcePath, value: Any) -> None:
        for name, holds in self._mapping(path, value):
            here = (*path, name)
            if name in self.mission.per_robot:
                robot = robot_condition(name, self._first)
                self._report.add(here, f"every robot has its own: say whose, as in {robot}")
            elif not self.mission.can_be_set(name):
                self._report.add(here, f"no condition{nearest(name, self.mission.conditions)}")
            elif not isinstance(holds, bool):
                self._report.add(here, f"true or false expected, found {found(holds)}")
            elif self.facts.condition(name) != holds:
                revision = self.facts.conditions.revision(name) + 1
                self._write(self._first, f"{records.CONDITION}/{name}", [holds, revision, 1])

    def _ended(self, path: SourcePath, value: Any, *, success: bool) -> None:
        for index, task in self._list(path, value):
            if not self._is_task((*path, index), task):
                continue
            for activation in self._activations(task):
                if not success:
                    self._write(self._first, f"{records.FAILURE}/{activation}", True)
                    continue
                for need in self.mission.global_tasks[task].needs:
                    able = self._able(need.local_task)[: need.min_robots]
                    if len(able) < need.min_robots:
                        text = f"no {need.min_robots} robots can do {need.local_task}"
                        self._report.add((*path, index), text)
                    for robot in able:
                        self._outcome(robot, activation, need.local_task, True)

    def _outcomes(self, path: SourcePath, value: Any) -> None:
        for index, row in self._list(path, value):
            here = (*path, index)
            if not isinstance(row, dict) or set(row) != _OUTCOME_KEYS:
                keys = ", ".join(sorted(_OUTCOME_KEYS))
                self._report.add(here, f"a mapping with {keys} expected")
                continue
            task, local_task, success = row["global_task"], row["local_task"], row["success"]
            if not self._is_robot(here, row["robot"]) or not self._is_task(here, task):
                continue
            needs = [need.local_task for need in self.mission.global_tasks[task].needs]
            if local_task not in needs:
                self._report.add(here, f"{task} needs no {local_task!r}{nearest('', needs)}")
            elif not isinstance(success, bool):
                self._report.add(here, f"success: true or false expected, found {found(success)}")
            else:
                for activation in self._activations(task):
                    self._outcome(row["robot"], activation, local_task, success)

    def _bids(self, path: SourcePath, value: Any) -> None:
        for task, needs in self._mapping(path, value):
            if not self._is_task((*path, task), task):
                continue
            by_bid = [n.local_task for n in self.mission.global_tasks[task].needs if n.by_bid]
            for local_task, rows in self._mapping((*path, task), needs):
                here = (*path, task, local_task)
                if local_task not in by_bid:
                    text = f"{task} has no bids for {local_task!r}{nearest(local_task, by_bid)}"
                    self._report.add(here, text)
                    continue
                for robot, bid in self._mapping(here, rows):
                    if self._is_robot((*here, robot), robot):
                        self._bid((*here, robot), robot, self._activations(task), local_task, bid)

    def _bid(
        self, path: SourcePath, robot: str, activations: list[str], local_task: str, bid: Any
    ) -> None:
        most = MAX_PERFORMANCE // MICRO
        is_number = isinstance(bid, int | float) and not isinstance(bid, bool)
        if bid is not None and not (is_number and -most <= bid <= most):
            text = f"a number from {-most} to {most}, or null, expected, found {found(bid)}"
            self._report.add(path, text)
            return
        for activation in activations:
            value = None if bid is None else round(bid * MICRO)
            self._write(robot, f"{records.BID}/{activation}/{local_task}", value)

    def _running(self, path: SourcePath, value: Any) -> None:
        for robot, task in self._mapping(path, value):
            here = (*path, robot)
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
        """The robot's claim, and that it has started with the others on the same task."""
        token = self._token(task)
        claim = Claim(activation, task, local_task, Phase.RUNNING, self._sequence + 1, token)
        self._write(robot, records.CLAIM, claim.to_value())
        if token:
            member = CoalitionMember(robot, local_task, *ALIVE, self._sequence, claim.since)
            self._crews.setdefault(f"{records.COALITION}/{activation}/{token}", []).append(member)

    def _token(self, task: str) -> str:
        """The one coalition of a task in a file; empty for tasks without."""
        by_coalition = self.mission.global_tasks[task].by_coalition
        return str(CoalitionId(1, self._first, *ALIVE)) if by_coalition else ""

    def _lost(self, path: SourcePath, value: Any) -> None:
        for robot, names in self._mapping(path, value):
            if self._is_robot((*path, robot), robot):
                lost = [str(name) for _, name in self._list((*path, robot), names)]
                before = self.facts.members[robot].member
                self._write_member(robot, before, lost)

    def _performances(self, path: SourcePath, value: Any) -> None:
        for robot, rows in self._mapping(path, value):
            if not self._is_robot((*path, robot), robot):
                continue
            known = self.mission.robots[robot]
            described = Description(robot, known.type, known.capabilities, "", "", 0)
            for local_task, number in self._mapping((*path, robot), rows):
                try:
                    problem = described.perform(local_task, micro_performance(number))
                except ValueError as error:
                    problem = str(error)
                if problem is not None:
                    self._report.add((*path, robot, local_task), problem)
            self._write(robot, records.MEMBER, described.member(is_leaving=False).to_value())

    def _order(self, path: SourcePath, value: Any) -> None:
        kinds = [str(kind) for kind in OrderKind]
        if value in kinds:
            self._write(self._first, records.ORDER, [value, 1])
        else:
            self._report.add(path, f"one of {', '.join(kinds)} expected, found {found(value)}")

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

    def _mapping(self, path: SourcePath, value: Any) -> list[tuple[str, Any]]:
        if isinstance(value, dict):
            return [(str(key), item) for key, item in value.items()]
        self._report.add(path, f"a mapping expected, found {found(value)}")
        return []

    def _list(self, path: SourcePath, value: Any) -> list[tuple[int, Any]]:
        if isinstance(value, list):
            return list(enumerate(value))
        self._report.add(path, f"a list expected, found {found(value)}")
        return []

    def _is_robot(self, path: SourcePath, value: Any) -> bool:
        if value in self.mission.robots:
            return True
        self._report.add(path, f"no robot {value!r}{nearest(str(value), self.mission.robots)}")
        return False

    def _is_task(self, path: SourcePath, value: Any) -> bool:
        if isinstance(value, str) and value in self.mission.global_tasks:
            return True
        hint = nearest(str(value), self.mission.global_tasks)
        self._report.add(path, f"no global task {value!r} in this mission{hint}")
        return False
