"""The way to another revision of the mission: proposed, held by all, in force.

A robot that holds a proposal begins nothing until it is in force or void. Once it is in force, the
robot begins nothing until all others act by it too. So no two robots that hear one another act by
different trees; one that was away learns of the revision before it joins.
"""

from __future__ import annotations

import json
from collections.abc import Collection

from mrbt_mesh.core.agent.context import Context
from mrbt_mesh.core.agent.effects import CheckMission
from mrbt_mesh.core.agent.inputs import MissionChecked
from mrbt_mesh.core.facts import records
from mrbt_mesh.core.facts.records import (
    LATCH,
    AdoptedMission,
    HeldMission,
    ProposedMission,
)
from mrbt_mesh.core.facts.revisions import read_mission
from mrbt_mesh.core.membership.timing import Timing
from mrbt_mesh.core.mission.failure_reasons import one_line
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.core.planning.objections import objections
from mrbt_mesh.core.planning.revised import revision_changes
from mrbt_mesh.errors import FileError


def size_problem(before: Mission, after: Mission, timing: Timing) -> str:
    """Why a team cannot have as many robots as a revision names; empty if it can."""
    sizes = len(before.robots), len(after.robots)
    if len({timing.all_are_neighbours(size) for size in sizes}) == 1:
        return ""
    return (
        f"a team of {sizes[0]} robots cannot become one of {sizes[1]} while it runs, since small "
        "and large teams exchange heartbeats in different ways: start it anew"
    )


class Reviser:
    """One robot's part in revisions."""

    def __init__(self, context: Context) -> None:
        self._context = context
        # The digest of the revision that the runtime was asked about, and what it has said.
        self._asked = ""
        self._answer: str | None = None

    def propose(self, argument: str, now_us: int) -> tuple[bool, str]:
        """An operator proposes a revision: JSON of `mission` (compiled), `operator`, `force` and
        `repeat_exclusive`, in a team with keys also of `signer` and `signature`, as of a job.
        """
        context, revisions = self._context, self._context.facts.revisions
        try:
            given = json.loads(argument)
            text, operator, is_forced = (given[key] for key in ("mission", "operator", "force"))
            repeats, stamp = given.get("repeat_exclusive", False), context.facts.max_stamp + 1
            proof = given.get("signer", ""), given.get("signature", "")
            proposed = ProposedMission.parse([text, operator, is_forced, repeats, stamp, *proof])
            mission = read_mission(text)
        except (ValueError, TypeError, KeyError, RecursionError, FileError) as error:
            return False, f"this is no revision of the mission: {one_line(str(error))}"
        number, next_number = mission.revision_number, revisions.last_number + 1
        if number != next_number or mission.team_digest != context.mission.team_digest:
            return False, f"revision {number} is out of date, the next one is {next_number}"
        if revisions.pending(context.mission.revision_number) is not None:
            return False, f"revision {revisions.last_number} is not in force yet: withdraw it first"
        name = f"{records.MISSION}/{number}"
        if not context.replica.is_by_operator(name, proposed):
            return False, "no operator of this team has signed this revision"
        context.log("warning", "revision_proposed", number=number, operator=operator)
        context.write([(name, proposed)], now_us)
        return True, f"revision {number} is proposed"

    def check(self, argument: str, _: int) -> tuple[bool, str]:
        """Whether the robot's program could do a compiled mission: JSON of `problem`, null while
        the runtime has not looked yet.
        """
        try:
            mission = read_mission(argument)
        except FileError as error:
            return False, f"this is no mission: {one_line(str(error))}"
        problem = "" if self._context.me not in mission.robots else self._program_problem(mission)
        return True, json.dumps({"problem": problem})

    def withdraw(self, argument: str, now_us: int) -> tuple[bool, str]:
        """An operator takes a proposal back; `argument` is its number."""
        context, in_force = self._context, self._context.mission.revision_number
        pending = context.facts.revisions.pending(in_force)
        if pending is None or str(pending[1].revision_number) != argument:
            return False, f"revision {argument[:20]!r} is not proposed; {in_force} is in force"
        context.write([(f"{records.MISSION_WITHDRAWN}/{argument}", LATCH)], now_us)
        return True, f"revision {argument} is withdrawn"

    def checked(self, event: MissionChecked, _: int) -> None:
        """The runtime has looked whether the robot's program can do what a revision asks for."""
        if event.digest == self._asked:
            self._answer = event.problem

    def may_begin(self) -> bool:
        """Whether the robot may begin something, as far as revisions are concerned."""
        facts = self._context.facts
        number = facts.declared.revision_number
        return facts.revisions.pending(number) is None and facts.revisions.all_act_by(
            number, self._context.alive()
        )

    def follow(self, now_us: int) -> None:
        """Write which revision this robot holds and acts by, and that one is in force."""
        context, revisions = self._context, self._context.facts.revisions
        in_force = context.facts.declared.revision_number
        held, pending = revisions.held_by(context.me), revisions.pending(in_force)
        number, digest, problem = held.number, held.digest, held.problem
        if pending is not None and pending[1].digest != held.digest:
            answer = self._problem(*pending)
            if answer is None:
                return  # the runtime has not answered yet
            mission = pending[1]
            number, digest, problem = mission.revision_number, mission.digest, one_line(answer)
        acts_by = held.in_force if context.work.is_stopping else in_force
        mine = HeldMission(number, digest, problem, acts_by)
        if mine != held:
            context.write([(records.MISSION_HELD, mine)], now_us)
        alive = context.alive()
        if (
            pending is not None
            and context.me == min(alive)
            and revisions.is_held_by_all(pending[1], alive)
            and self._may_adopt(alive)
        ):
            number, digest = pending[1].revision_number, pending[1].digest
            adopted = AdoptedMission(digest)
            context.log("info", "revision_adopted", number=number)
            context.write([(f"{records.MISSION_ADOPTED}/{number}", adopted)], now_us)

    def _may_adopt(self, alive: Collection[str]) -> bool:
        """Leases are of a majority of the robots that the mission names: none may be left behind
        that could grant one by the mission before.
        """
        mission = self._context.mission
        is_exclusive = any(task.exclusive for task in mission.all_tasks())
        return not is_exclusive or 2 * len(mission.robot_ids.intersection(alive)) > len(
            mission.robots
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
            repeats_exclusive=proposed.repeats_exclusive,
        )
        if reasons:
            return reasons[0]
        return "" if context.me not in mission.robots else self._program_problem(mission)

    def _program_problem(self, mission: Mission) -> str | None:
        """Why the robot's program cannot do a mission; None until the runtime has answered."""
        if self._asked != mission.digest:
            self._asked, self._answer = mission.digest, None
            self._context.emit(CheckMission(mission))
        return self._answer
