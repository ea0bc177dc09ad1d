"""I3: work behind conditions is done again if they turn against it, and only then.

Found from the tree and the values of conditions, without the guards that the product derives.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from itertools import product
from operator import lt

from mrbt_mesh.core.agent.view import AgentView
from mrbt_mesh.core.bt.activation import parse_activation
from mrbt_mesh.core.bt.evaluation import OverlaidFacts, OwnFacts
from mrbt_mesh.core.bt.guards import conditions_in
from mrbt_mesh.core.bt.tree import Status
from mrbt_mesh.core.facts.records import ExpressionChanges, Reading
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.core.mission.names import split_owner
from mrbt_mesh.core.planning.plan import Plan
from mrbt_mesh.sim.checkers.barriers import Barrier, barriers
from mrbt_mesh.sim.checkers.findings import RunFindings
from mrbt_mesh.sim.world.process import SimProcess

# Of more conditions that have changed not all combinations are tried out.
MAX_CONDITIONS = 6


@dataclass
class _Seen:
    """One process: its last plan, the mission in force, the last activation of each node, and the
    nodes renewed since.
    """

    plan: Plan | None = None
    mission: Mission | None = None
    barriers: list[Barrier] = field(default_factory=list)
    requested: dict[int, str] = field(default_factory=dict)
    turned: set[int] = field(default_factory=set)


class Renewals:
    """I3: an action gets another activation if conditions have turned against it, and only then."""

    def __init__(self, run: RunFindings) -> None:
        self._run = run
        self._seen: dict[SimProcess, _Seen] = {}
        # By the digest of the facts: robots that know the same lack the same.
        self._late: dict[bytes, bool] = {}

    def check(self, process: SimProcess, agent: AgentView) -> None:
        """After a step, whenever there is another plan, and it is that of the facts as they are."""
        seen = self._seen.setdefault(process, _Seen())
        plan = agent.plan
        if plan is None or plan is seen.plan or not agent.is_plan_current or agent.is_joining:
            return
        seen.plan = plan
        if seen.mission is not agent.facts.in_force:  # the first one, or another revision
            seen.mission = agent.facts.in_force
            seen.barriers = list(barriers(seen.mission.tree))
            seen.requested.clear()
            seen.turned.clear()
        is_late = self._has_late_news(agent.facts)
        nodes = plan.evaluation.tree.nodes
        for request in plan.evaluation.requests:
            if nodes[request.node].job:
                continue  # as other jobs come and go, its node has other numbers
            node = plan.evaluation.origin_of(request)
            last = seen.requested.pop(node, None)
            if last is not None:
                self._run.checks["I3"] += 1
                self._compare(agent, last, request.activation, node in seen.turned)
            seen.turned.discard(node)
            if not is_late:  # else its name may count a turn that this robot has not received yet
                seen.requested[node] = request.activation
        if seen.requested and not is_late:
            for barrier in seen.barriers:
                if barrier.keeps_out(set(filter(agent.facts.condition, barrier.conditions))):
                    seen.turned |= barrier.behind & seen.requested.keys()

    def _has_late_news(self, facts: TeamFacts) -> bool:
        """Whether others have read values of conditions that this robot has not received yet."""
        key = facts.map.digest()
        if key not in self._late:
            self._late[key] = any(lt(facts.conditions.seen(n), read) for n, read in _notes(facts))
        return self._late[key]

    def _compare(self, agent: AgentView, last: str, now: str, has_turned: bool) -> None:
        if last == now:
            if has_turned:
                text = "the conditions before it have turned against it, and it is not done again"
                self._run.violation("I3", f"for {agent.robot} {now}: {text}")
            return
        before, after = parse_activation(last), parse_activation(now)
        if before.attempts == after.attempts and not _may_turn(agent, after.node):
            text = f"is done again as {now}, though nothing has turned against it"
            self._run.violation("I3", f"for {agent.robot} {last} {text}")


def _may_turn(agent: AgentView, node: int) -> bool:
    """Whether the conditions that have ever changed can keep a node from being reached.

    With what actions have done so far, or with all of it to be done again: a condition that turns
    may have renewed the work before the node.
    """
    facts = agent.facts
    index = facts.mission.evaluator.index_of[node, ""]
    conditions = sorted(conditions_in(facts.mission.tree.spec(0)))
    changed = _changed(facts)
    names = [name for name in conditions if name in changed]
    if len(names) > MAX_CONDITIONS:
        return True
    for values in product((False, True), repeat=len(names)):
        supposed = dict(zip(names, values, strict=True))
        anew = {name: supposed.get(name, facts.condition(name)) for name in conditions}
        for each in (_Otherwise(facts, supposed), OwnFacts(set(filter(anew.get, anew)))):
            if facts.mission.evaluator.evaluate(each).statuses[index] == Status.IDLE.value:
                return True
    return False


@dataclass
class _Otherwise(OverlaidFacts):
    """The team's facts, with other values of some conditions."""

    values: Mapping[str, bool]

    def condition(self, name: str) -> bool:
        value = self.values.get(name)
        return super().condition(name) if value is None else value


def _notes(facts: TeamFacts) -> Iterator[tuple[str, Reading]]:
    """The conditions that robots have read for joint guards, and how often they had changed."""
    for entry in facts.map:
        if isinstance(entry.record, ExpressionChanges):
            mission, name = facts.mission, entry.parts[1]
            expression = mission.entries.expressions.get(name)
            guard = expression or mission.evaluator.with_actions.get(name)
            if guard is not None:  # else it is of a job that is not in the tree
                yield from zip(guard.conditions, entry.record.read, strict=True)


def _changed(facts: TeamFacts) -> set[str]:
    """The conditions that have ever changed, by the names that the tree reads: with the robot that
    they are of, or without.
    """
    names = {name for name in facts.conditions.names() if facts.conditions.changes(name)}
    names |= {name for name, changes in _notes(facts) if changes}
    return names | {split_owner(name)[0] for name in names}
