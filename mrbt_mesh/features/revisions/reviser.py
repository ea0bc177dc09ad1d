"""How a robot gets to another revision of the mission: proposed, held by all, in force.

A robot that holds a proposal begins nothing until it is in force or void. Once it is in force, the
robot begins nothing until all others act by it too. So no two robots that hear one another act by
different trees; a robot that was away learns of the revision before it joins.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Mapping
from typing import Any

from mrbt_mesh.core.agent.inputs import FeatureInput
from mrbt_mesh.core.agent.operator_desk import FieldRule, RefusalError
from mrbt_mesh.core.agent.operator_messages import CONFLICT, ENDED, NOT_READY
from mrbt_mesh.core.facts.records import Claim, OperatorCommand
from mrbt_mesh.core.facts.store import Entry
from mrbt_mesh.core.feature import Kit, Part
from mrbt_mesh.core.membership.timing import Timing
from mrbt_mesh.core.mission.failure_reasons import one_line
from mrbt_mesh.core.mission.mission import Mission, majority
from mrbt_mesh.core.mission.planner_need import planner_problem
from mrbt_mesh.errors import FileError
from mrbt_mesh.features.revisions.changes import revision_changes
from mrbt_mesh.features.revisions.facts import Revisions, read_mission
from mrbt_mesh.features.revisions.kinds import (
    MAX_MISSION,
    MISSION,
    MISSION_ADOPTED,
    MISSION_HELD,
    MISSION_WITHDRAWN,
)
from mrbt_mesh.features.revisions.messages import CHECK_REVISION, CheckMission, MissionChecked
from mrbt_mesh.features.revisions.objections import objections
from mrbt_mesh.features.revisions.records import AdoptedMission, HeldMission, ProposedMission


def size_problem(before: Mission, after: Mission, timing: Timing) -> str:
    """Why a running team cannot change to a revision's number of robots; empty if it can."""
    sizes = len(before.robots), len(after.robots)
    if len({timing.all_are_neighbours(size) for size in sizes}) == 1:
        return ""
    return (
        f"a team of {sizes[0]} robots cannot become one of {sizes[1]} while it runs, since small "
        "and large teams exchange heartbeats in different ways: start it anew"
    )


class Reviser(Part):
    """One robot's part in revisions."""

    def __init__(self, kit: Kit) -> None:
        self._context = kit.context
        # The digest of the revision that the runtime was asked about, and its answer.
        self._asked = ""
        self._answer: str | None = None

    @property
    def _revisions(self) -> Revisions:
        """The present index, which is replaced when a revision is in force or a key revoked."""
        return self._context.facts.index(Revisions)

    def handlers(self) -> Mapping[type[FeatureInput], Callable[[Any, int], object]]:
        return {MissionChecked: self._checked}

    def words(self) -> Mapping[str, Callable[[str, int], tuple[bool, str]]]:
        return {CHECK_REVISION: self._check_mission}

    def longest(self) -> Mapping[str, int]:
        return {CHECK_REVISION: MAX_MISSION}

    def rules(self) -> Mapping[str, FieldRule]:
        state = self._state
        return {
            MISSION: FieldRule(state, self._check_proposal, self._is_proposed),
            MISSION_WITHDRAWN: FieldRule(state, self._check_withdrawal),
        }

    def _state(self, number: str) -> dict[str, Any]:
        """A revision's state. `proposed`: the digest of the mission proposed under this number."""
        revisions, in_force = self._revisions, self._context.mission.number
        proposed = revisions.proposed(int(number))
        return {
            "proposed": read_mission(proposed.text).digest if proposed is not None else "",
            "in_force": in_force,
            "void": revisions.void_reason(int(number)),
        }

    def _is_proposed(self, entry: Entry) -> bool:
        """True if this very mission is proposed. Raises RefusalError if another one is."""
        number = int(entry.parts[1])
        found = self._revisions.proposed(number)
        if found is not None and found != _proposal(entry):
            text = f"another revision {number} is proposed; look at it, and propose yours again"
            raise RefusalError(text, CONFLICT)
        return found is not None

    def _check_proposal(self, entry: Entry, _: int) -> None:
        context, revisions = self._context, self._revisions
        number, next_number = int(entry.parts[1]), revisions.last_number + 1
        if context.mission.number < number < next_number:
            # It may be this very proposal: its operator asks again, and other robots were quicker.
            text = f"{context.me} does not know yet what revision {number} is"
            raise RefusalError(text, NOT_READY)
        if number != next_number:
            text = f"revision {number} is out of date, the next one is {next_number}"
            raise RefusalError(text, CONFLICT)
        if revisions.pending(context.mission.number) is not None:
            text = f"revision {revisions.last_number} is not in force yet: withdraw it first"
            raise RefusalError(text, CONFLICT)

    def _check_mission(self, argument: str, _: int) -> tuple[bool, str]:
        """Check if the robot's program could do a compiled mission. The answer is JSON with
        `problem`, which is null until the runtime has checked.
        """
        try:
            mission = read_mission(argument)
        except FileError as error:
            return False, f"this is not a mission: {one_line(str(error))}"
        problem = self._own_problem(mission)
        return True, json.dumps({"problem": problem})

    def _check_withdrawal(self, entry: Entry, _: int) -> None:
        in_force = self._context.mission.number
        pending, number = self._revisions.pending(in_force), entry.parts[1]
        if pending is None or str(pending[1].number) != number:
            text = f"revision {number[:20]!r} is not proposed; {in_force} is in force"
            raise RefusalError(text, ENDED)

    def _checked(self, event: MissionChecked, _: int) -> None:
        """Note the runtime's answer on whether the robot's program can do a revision."""
        if event.digest == self._asked:
            self._answer = event.problem

    def may_begin(self, claim: Claim, now_us: int) -> bool:
        revisions = self._revisions
        if not revisions.is_used:
            return True
        number = self._context.facts.in_force.number
        alive = self._context.alive()
        return revisions.pending(number) is None and revisions.all_act_by(number, alive)

    def taken_up(self, mission: Mission) -> None:
        self._context.log("info", "revision_taken_up", number=mission.number)

    def agree(self, now_us: int) -> None:
        """Write which revision this robot holds and acts by, and that one is in force."""
        if self._revisions.is_used:
            self._write(now_us)

    def _write(self, now_us: int) -> None:
        context, revisions = self._context, self._revisions
        in_force = context.facts.in_force.number
        held, pending = revisions.held_by(context.me), revisions.pending(in_force)
        number, digest, problem = held.number, held.digest, held.problem
        if pending is not None and pending[1].digest != held.digest:
            answer = self._problem(*pending)
            if answer is None:
                return  # the runtime has not answered yet
            mission = pending[1]
            number, digest, problem = mission.number, mission.digest, one_line(answer)
        acts_by = held.in_force if context.work.is_stopping else in_force
        mine = HeldMission(number, digest, problem, acts_by)
        if mine != held:
            context.write([(MISSION_HELD, mine)], now_us)
        alive = context.alive()
        if (
            pending is not None
            and context.me in sorted(alive)[:2]  # two of them, as one may lie
            and revisions.is_held_by_all(pending[1], alive)
            and self._may_adopt(alive)
        ):
            number, digest = pending[1].number, pending[1].digest
            adopted = AdoptedMission(digest)
            context.log("info", "revision_adopted", number=number)
            context.write([(f"{MISSION_ADOPTED}/{number}", adopted)], now_us)

    def _may_adopt(self, alive: Collection[str]) -> bool:
        """True if enough robots are alive. For a task that is done at most once, no majority may be
        left behind that could begin it under the previous mission.
        """
        mission = self._context.mission
        named = mission.robot_ids
        return not mission.has_tasks_at_most_once or len(named.intersection(alive)) >= majority(
            named
        )

    def _problem(self, proposed: ProposedMission, mission: Mission) -> str | None:
        """Why this robot does not hold a revision; empty if it does, None while that is open."""
        context, alive = self._context, self._context.alive()
        if problem := size_problem(context.mission, mission, context.config.timing):
            return problem
        changes = revision_changes(context.facts, mission, alive)
        reasons = objections(
            context.facts,
            mission,
            changes,
            alive,
            is_forced=proposed.is_forced,
            may_repeat=proposed.may_repeat,
        )
        if reasons:
            return reasons[0]
        return self._own_problem(mission)

    def _own_problem(self, mission: Mission) -> str | None:
        """Why this robot cannot take part in a mission; None until the runtime has answered."""
        context = self._context
        is_named = context.me in mission.robots
        if not is_named and context.me in context.mission.robots:
            return ""  # it leaves
        if problem := planner_problem(mission, context.config.lacks_planner):
            return problem
        return self._program_problem(mission) if is_named else ""

    def _program_problem(self, mission: Mission) -> str | None:
        """Why the robot's program cannot do a mission; None until the runtime has answered."""
        if self._asked != mission.digest:
            self._asked, self._answer = mission.digest, None
            self._context.emit(CheckMission(mission))
        return self._answer


def _proposal(entry: Entry) -> ProposedMission:
    assert isinstance(entry.record, OperatorCommand)
    assert isinstance(entry.record.value, ProposedMission)
    return entry.record.value
