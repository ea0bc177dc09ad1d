"""Whom a robot tells what it plans, in a team in which not all are neighbours.

The speakers of its section (`core/membership/sections.py`) hear of each new plan. Once all of a
section report a speaker's plan, that speaker tells those who wait for agreement,
to begin something or to say that it has failed. Who was told so is told when it is no more so.
"""

from __future__ import annotations

from mrbt_mesh.core.agent.context import Context
from mrbt_mesh.core.agent.planner import Planner
from mrbt_mesh.core.facts import records
from mrbt_mesh.core.facts.records import Phase
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.membership.neighbourhood import Neighbourhood
from mrbt_mesh.core.membership.sections import Sections
from mrbt_mesh.core.membership.wire import SelfReport
from mrbt_mesh.core.planning.plan import Plan


class PlanNews:
    """What this robot has told of plans, to whom, and until when it tells it again."""

    def __init__(self, context: Context, planner: Planner, now_us: int) -> None:
        self._context = context
        self._planner = planner
        self._sections = Sections(
            context.me,
            context.mission.robots,
            context.membership.peers,
            context.config.timing.reach,
        )
        # What was found of the section, and what that was found from.
        self._is_agreed = False
        self._agreed_from: tuple[bytes, int, int] | None = None
        # What is told, and to which speakers; until when heartbeats repeat it.
        self._tells: tuple[bytes, bool, tuple[str, ...]] | None = None
        self._until_us = now_us
        # Who was told that the section agrees on which plan; and who still goes by one that is no
        # more agreed on.
        self._told: set[str] = set()
        self._told_plan: Plan | None = None
        self._misled: set[str] = set()

    def agrees(self, digest: bytes) -> bool:
        """Whether this robot speaks for its section, and all of that report this plan."""
        membership = self._context.membership
        found_from = digest, membership.report_changes, membership.member_changes
        if found_from != self._agreed_from:
            self._agreed_from = found_from
            self._is_agreed = (
                bool(digest)
                and not membership.neighbourhood.is_complete
                and self._context.me in self._sections.speakers()
                and self._sections.all_report(digest)
            )
        return self._is_agreed

    def hearers(
        self, digest: bytes, is_agreed: bool, number: int, now_us: int
    ) -> tuple[set[str], dict[str, SelfReport]]:
        """Who is to get heartbeat `number` because of plans, and what it relays to them.

        A repetition, for what was lost, goes to one speaker after the other.
        """
        speakers = self._sections.speakers()
        tells = digest, is_agreed, speakers
        if tells == self._tells:
            speakers = speakers[number % len(speakers) :][:1]
        else:
            self._tells = tells
            self._until_us = now_us + self._context.config.timing.repeat_offsets_us()[-1]
            self._misled = self._still_waiting()
            self._told = set()
        plan, around = self._planner.plan, self._context.membership.neighbourhood
        if plan is None or around.is_complete:
            return set(), {}
        is_new = now_us <= self._until_us
        told = set(self._misled) if is_new else set()
        if is_agreed:
            waiting = who_waits(plan, self._context.facts, around)
            told |= waiting if is_new else waiting - self._told
            self._told |= waiting
            self._told_plan = plan
        relays = self._sections.relays() if told else {}
        return (told.union(speakers) if is_new else told), relays

    def _still_waiting(self) -> set[str]:
        """Of those that were told of an agreement the ones that have not begun by it."""
        context, plan = self._context, self._told_plan
        if plan is None or not self._told:
            return set()
        return self._told & who_waits(plan, context.facts, context.membership.neighbourhood)


def who_waits(plan: Plan, facts: TeamFacts, around: Neighbourhood) -> set[str]:
    """The robots that wait until all plan the same: those that the plan has begin something, and
    some that say so when it has failed something for long enough.
    """
    found = set()
    for robot, line in plan.lines.items():
        claim = facts.valid_claim(robot)
        runs = claim is not None and claim.phase is Phase.RUNNING
        if claim is None or not runs or claim.activation != line.activation:
            found.add(robot)
    verdicts = [verdict.verdict_name for verdict in plan.pending_verdicts]
    for name in (*verdicts, *(loss.fact[0] for loss in plan.pending_losses)):
        found.update(around.monitors(name))
    if plan.is_about_to_end(facts.mission):
        found.update(around.monitors(records.RESULT))
    return found
