"""I4: nobody works on what it cannot do, and bounds hold. I6: what can be finished is finished."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

from mrbt_mesh.core.agent.effects import Effect, Persist, StartAction, Stop
from mrbt_mesh.core.agent.inputs import ActionFinished, Input
from mrbt_mesh.core.agent.view import AgentView
from mrbt_mesh.core.bt.evaluation import Request
from mrbt_mesh.core.bt.tree import Kind, Status
from mrbt_mesh.core.facts.records import (
    COALITION_KINDS,
    Attempt,
    Claim,
    ConditionValue,
    Latch,
    Member,
    OrderKind,
    Outcome,
    Phase,
)
from mrbt_mesh.core.facts.store import Entry, Incarnation
from mrbt_mesh.core.facts.team_facts import TeamFacts, capability
from mrbt_mesh.core.mission.mission import MICRO, InDoubtPolicy, Mission, MissionEnd, performance
from mrbt_mesh.core.planning.capabilities import capabilities_of, workers
from mrbt_mesh.core.planning.demands import demands_of
from mrbt_mesh.core.planning.plan import Plan
from mrbt_mesh.core.planning.side_constraints import feasibility
from mrbt_mesh.sim.checkers.barriers import lacked
from mrbt_mesh.sim.checkers.findings import RunFindings, current_plan, is_connected, joined
from mrbt_mesh.sim.checkers.finishing import can_finish
from mrbt_mesh.sim.world.process import SimProcess

_OVER = (Status.SUCCESS, Status.FAILURE)


class WorkWithinBounds:
    """I4: nobody works on what it cannot do; nu and mu hold where all hear one another.

    And nobody is taken off what it runs while the plan serves the same request.
    """

    def __init__(self, findings: RunFindings) -> None:
        self._findings = findings
        tasks = findings.world.mission.global_tasks.values()
        self._preempts = any(task.preemptive for task in tasks)

    def cancelled(self, agent: AgentView, claim: Claim) -> None:
        """The agent has just given up what it was running under `claim`."""
        facts, plan = agent.facts, agent.plan
        if agent.mission.global_tasks[claim.global_task].by_coalition:
            return  # it stops with the others
        if self._preempts or plan is None or plan.order is not OrderKind.RESUME:
            return
        if agent.is_joining or agent.is_leaving or not is_served(plan, claim.activation):
            return
        member, results = facts.members[agent.robot].member, facts.results(*_place(claim))
        if agent.robot in results or capability(member, claim.local_task) is None:
            return
        if lacked(facts, claim.activation, agent.robot):
            return
        needs = agent.mission.global_tasks[claim.global_task].needs
        need = next(need for need in needs if need.local_task == claim.local_task)
        room = max(need.min_robots - sum(results.values()), need.max_robots - len(results), 0)
        before = 0
        for robot in workers(facts, agent.alive()):
            other, life = facts.claims.get(robot, (None, None))
            if other is None or life != facts.members[robot].incarnation:
                continue  # of an earlier life
            if robot not in results and _place(other) == _place(claim):
                running = other.phase is Phase.RUNNING and robot != agent.robot
                before += running and (other.since, robot) < (claim.since, agent.robot)
        if before < room and keeps_pin(agent, plan, claim):
            text = f"{agent.robot} is taken off {claim.local_task} of {claim.activation}"
            self._findings.say("I4", f"{text}, which it runs and the plan serves")

    def started(self, agent: AgentView, start: StartAction) -> None:
        member = agent.facts.members[agent.robot].member
        if capability(member, start.local_task) is None:
            text = f"{agent.robot} starts {start.local_task}, which it cannot do"
            self._findings.say("I4", text)
        if condition := lacked(agent.facts, start.activation, agent.robot):
            text = f"{agent.robot} starts {start.local_task}, but {condition} does not hold for it"
            self._findings.say("I4", text)
        world = self._findings.world
        delay_us = world.network.slowest_us + 2 * world.plan_delay_us
        prompt = delay_us < world.timing.grace_us // 4
        if prompt and world.network.is_reliable_at(world.clock.now_us) and not world.cut_off:
            self._check_crowd(agent, start)

    def _check_crowd(self, agent: AgentView, start: StartAction) -> None:
        """Where all hear one another in time, mu holds at every moment."""
        place = (start.activation, start.local_task)
        robots = [
            process.robot
            for process in self._findings.world.living()
            if process.agent is not None
            and (action := process.agent.view.action) is not None
            and (action.activation, action.local_task) == place
        ]
        needs = agent.mission.global_tasks[start.global_task].needs
        most = next((n.max_robots for n in needs if n.local_task == start.local_task), 0)
        if len(robots) > most:
            who = ", ".join(robots)
            self._findings.say(
                "I4", f"{who} are on {place[1]} of {place[0]}, at most {most} may be"
            )

    def at_rest(self, agents: Sequence[AgentView]) -> None:
        """Everybody does its line of the one plan, and the bounds of every demand hold."""
        self._findings.checks["I4"] += 1
        agent, alive = agents[0], {agent.robot: agent.incarnation for agent in agents}
        plan = current_plan(agent, self._findings.world.solver)
        tasks, ungranted = agent.mission.global_tasks, self._findings.may_lack_grants
        for each in agents:
            line, claim = plan.assignments.get(each.robot), each.claim
            wanted = (line.activation, line.local_task) if line else None
            runs = claim is not None and claim.phase is Phase.RUNNING
            found = (claim.activation, claim.local_task) if claim and runs else None
            if line is not None and tasks[line.global_task].exclusive and ungranted:
                continue
            if wanted != found:
                text = f"{each.robot} works on {found}, by the plan on {wanted}"
                self._findings.say("I4", text)
        if plan.order is not OrderKind.RESUME or plan.result in _OVER:
            return  # nobody is asked for anything any more
        waiting = {w.activation for w in plan.waiting}
        on = Counter((line.activation, line.local_task) for line in plan.assignments.values())
        capable = capabilities_of(agent.facts, alive)
        for group in demands_of(agent.facts, plan.evaluation.requests, capable):
            for demand in group:
                place = (demand.request.activation, demand.local_task)
                low = 0 if place[0] in waiting else demand.lower
                if not low <= on[place] <= demand.upper:
                    bounds = f"{place[0]}: {low}..{demand.upper}"
                    text = f"{on[place]} robots on {demand.local_task} of {bounds}"
                    self._findings.say("I4", text)


def _place(claim: Claim) -> tuple[str, str]:
    return claim.activation, claim.local_task


def keeps_pin(agent: AgentView, plan: Plan, claim: Claim) -> bool:
    """Whether the claim's request can be met with all running robots left where they are.

    Otherwise pins may yield, also this one.
    """
    facts = agent.facts
    capable = capabilities_of(facts, agent.alive())
    groups = [list(group) for group in demands_of(facts, plan.evaluation.requests, capable)]
    obstacles = {waiting.activation for waiting in plan.waiting if waiting.obstacle}
    for index, group in enumerate(groups):
        for number, demand in enumerate(group):
            if (demand.request.activation, demand.local_task) == _place(claim):
                others = [robot for robot in demand.pinned if robot != agent.robot]
                groups[index][number] = replace(demand, pinned=(*others, agent.robot))
    pinned = {r: i for i, group in enumerate(groups) for d in group for r in d.pinned}
    check = feasibility(facts.mission.constraints, list(capable.team), groups)
    return any(
        check.keep(index, group, pinned) and group[0].request.activation == claim.activation
        for index, group in enumerate(groups)
        if group[0].request.activation not in obstacles
    )


def is_served(plan: Plan, activation: str) -> bool:
    """Whether the plan keeps the request of this activation."""
    requested = any(request.activation == activation for request in plan.evaluation.requests)
    return requested and all(waiting.activation != activation for waiting in plan.waiting)


class Progress:
    """I6: after the last fault everybody joins, and the mission goes on, as long as the living can
    serve a request.

    `is_settled`: the mission is over, or rests for good because nothing that it asks for can be
    served, or goes on as one does that may go on for ever. `done_twice` counts successes beyond
    mu of a local task: what a partition or a crash may cost where a task is not exclusive.
    """

    def __init__(self, findings: RunFindings) -> None:
        self._findings = findings
        self._progress_us = 0
        declared = [robot.capabilities for robot in findings.world.mission.robots.values()]
        self._longest_us = longest_us(findings.world.mission, findings.world.speed, declared)
        self.is_endless = is_endless(findings.world.mission)
        self._done: set[tuple[object, ...]] = set()
        self._successes: Counter[tuple[str, str, str]] = Counter()
        self.is_settled = False

    @property
    def done_twice(self) -> int:
        tasks = self._findings.world.mission.global_tasks
        most = {(t.id, n.local_task): n.max_robots for t in tasks.values() for n in t.needs}
        return sum(
            max(0, count - most[task, local_task])
            for (task, local_task, _), count in self._successes.items()
        )

    def handled(self, process: SimProcess, event: Input, effects: Iterable[Effect]) -> None:
        for effect in effects:
            if isinstance(effect, Stop) and effect.reason.startswith("mission "):
                self._may_stop(process)
            written = effect.entries if isinstance(effect, Persist) and effect.at_once else ()
            for entry in written:
                if self._is_progress(entry):
                    self._progress_us = self._findings.world.clock.now_us
                if isinstance(entry.record, Member):
                    self._may_take_longer(entry.record)

    def _may_stop(self, process: SimProcess) -> None:
        """A robot stops since the mission is over: not so where it never is, but for an abort."""
        agent = process.agent.view if process.agent is not None else None
        stands_by = self._findings.world.mission.ends is MissionEnd.NEVER
        if stands_by and agent and agent.facts.order() is not OrderKind.ABORT:
            self._findings.say("I6", f"{agent.robot} stopped, but the mission never ends")

    def _may_take_longer(self, member: Member) -> None:
        """A robot that says how well it does things now may be slower than any was before."""
        world = self._findings.world
        longest = longest_us(world.mission, world.speed, [member.capabilities])
        self._longest_us = max(self._longest_us, longest)

    def _is_progress(self, entry: Entry) -> bool:
        """Not that a coalition forms or breaks, nor that it repeats what another one has done."""
        kind, *scope = entry.parts
        if isinstance(entry.record, Outcome):
            done = (entry.author, *scope[:2], entry.record.success)
            is_new = done not in self._done
            self._done.add(done)
            return is_new
        kinds = (Attempt, Latch, ConditionValue)
        return isinstance(entry.record, kinds) and kind not in COALITION_KINDS

    def finishing(self, agent: AgentView, event: Input) -> None:
        """Before a step: an action is about to end."""
        action = agent.action
        if isinstance(event, ActionFinished) and action and action.ticket == event.ticket:
            key = (action.global_task, action.local_task, action.activation)
            self._successes[key] += event.success

    def sample(self) -> None:
        world, findings = self._findings.world, self._findings
        healed_us, now_us = world.healed_us, world.clock.now_us
        if healed_us is None or not findings.is_tolerable:
            return
        agents = joined(world)
        if len(agents) < len(world.living()):
            self._check_joining(agents)
            return
        if not agents or not is_connected(agents, world.network.blocked):
            return
        if not findings.checks["I6"] and servable(agents[0], agents[0].alive()):
            findings.checks["I6"] += 1  # from now on it is demanded
        quiet_us = now_us - max(healed_us, findings.fault_us)
        still_us = min(quiet_us, now_us - self._progress_us)
        patience_us = self._patience_us
        if still_us <= findings.repair_us + findings.failure_latch_us:
            self.is_settled = self.is_endless and quiet_us > patience_us
            return
        if all(agent.plan and agent.plan.result in _OVER for agent in agents):
            # Where the team stands by, sensors may ask for more.
            self.is_settled = world.mission.ends is MissionEnd.ONCE or quiet_us > patience_us
            return
        if still_us <= patience_us:
            return
        exclusive = any(task.exclusive for task in world.mission.global_tasks.values())
        if exclusive and findings.may_lack_grants:
            self.is_settled = True
            return
        for agent in agents:
            waits = agent.waits_for_deadline
            request = servable(agent, agent.alive())
            if request is None and (waits or agent.facts.order() is OrderKind.PAUSE):
                return
            could = f"{request} could be served" if request else "the mission could be finished"
            if request is not None or can_finish(agent, agent.alive()):
                text = f"for {agent.robot}, {could}, but nothing was finished "
                findings.say("I6", text + f"for {still_us / 1e6:.1f} s after the last fault")
                self.is_settled = True
        self.is_settled = True

    def _check_joining(self, agents: Sequence[AgentView]) -> None:
        """Some have not taken their place in the team."""
        findings, world = self._findings, self._findings.world
        waits_us = world.clock.now_us - max(world.healed_us or 0, findings.fault_us)
        if waits_us > 2 * (findings.repair_us + findings.failure_latch_us):
            late = {process.robot for process in world.living()} - {agent.robot for agent in agents}
            text = f"{', '.join(sorted(late))} did not join within {waits_us / 1e6:.1f} s"
            findings.say("I6", f"{text} after the last fault")
            self.is_settled = True

    def never_stopped(self) -> None:
        """Some time after robots stopped because the mission is over."""
        names = ", ".join(process.robot for process in self._findings.world.living())
        if names:
            self._findings.say("I6", f"the mission is over, but {names} did not stop")

    @property
    def _patience_us(self) -> int:
        """How long nothing may be finished by robots that have something to do."""
        return 2 * (self._findings.repair_us + self._findings.failure_latch_us) + self._longest_us

    def timed_out(self) -> None:
        """After a run without a result: the living could have gone on, and did not.

        A team at work has only been given too little time, as any has whose mission never ends.
        """
        world = self._findings.world
        agents = [p.agent.view for p in world.living() if p.agent is not None]
        if not agents or world.network.blocked or world.healed_us is not None:
            return
        still_us = world.clock.now_us - max(self._progress_us, self._findings.fault_us)
        if any(agent.action for agent in agents) or still_us <= self._patience_us:
            return
        if all(agent.plan and agent.plan.result in _OVER for agent in agents):
            return  # they stand by
        if can_finish(agents[0], {agent.robot: agent.incarnation for agent in agents}):
            text = "the living robots could finish the mission, but nothing was finished for"
            self._findings.say("I6", f"{text} {still_us / 1e6:.1f} s")


def is_endless(mission: Mission) -> bool:
    """Whether something in the tree may be repeated for ever."""
    nodes = mission.tree.nodes
    return any(n.kind is Kind.KEEP_RUNNING_UNTIL_FAILURE or n.limit < 0 for n in nodes)


def longest_us(mission: Mission, speed: float, capabilities: Iterable[Mapping[str, int]]) -> int:
    """How long the slowest of these robots takes for the longest local task of the mission."""
    robots = list(capabilities)
    longest = 0
    for task in mission.global_tasks.values():
        for need in task.needs:
            work = mission.nominal_work(need.local_task)
            able = (performance(each, need.local_task) for each in robots)
            for value in filter(None, able):
                longest = max(longest, work * MICRO // value)
    return round(longest / speed)


def servable(agent: AgentView, alive: Mapping[str, Incarnation]) -> str | None:
    """A request of T_G that the living could serve, whoever else may wait; None if there is none.

    Found by trying out who could do what, without the planner.
    """
    facts = agent.facts
    if facts.order() is not OrderKind.RESUME:
        return None
    for request in agent.mission.evaluator.evaluate(facts).requests:
        if not _is_excepted(facts, request, alive) and _can_serve(facts, request, alive):
            return request.activation
    return None


def _is_excepted(facts: TeamFacts, request: Request, alive: Mapping[str, Incarnation]) -> bool:
    """An exclusive task without a living majority, or held in doubt after it was granted once."""
    task = facts.mission.global_tasks[request.subject]
    if not task.exclusive:
        return False
    present = sum(robot in facts.mission.robots for robot in alive)
    granted = bool(facts.coalitions(request.activation).grants)
    held = granted and task.in_doubt is InDoubtPolicy.HOLD
    return held or 2 * present <= len(facts.mission.robots)


def _can_serve(facts: TeamFacts, request: Request, alive: Mapping[str, Incarnation]) -> bool:
    slots: list[list[str]] = []
    task = facts.mission.global_tasks[request.subject]
    for need in task.needs:
        results = facts.results(request.activation, need.local_task)
        if task.by_coalition:  # all of it is done by one coalition; who has failed is in none
            results = {robot: False for robot, success in results.items() if not success}
        able = []
        for robot, incarnation in sorted(alive.items()):
            known = facts.members.get(robot)
            if known is None or known[1] != incarnation or known[0].is_leaving:
                continue
            if robot in results or lacked(facts, request.activation, robot):
                continue
            if capability(known[0], need.local_task) is not None:
                able.append(robot)
        slots += [able] * max(0, need.min_robots - sum(results.values()))

    def seat(number: int, taken: frozenset[str]) -> bool:
        if number == len(slots):
            return True
        return any(seat(number + 1, taken | {r}) for r in slots[number] if r not in taken)

    slots.sort(key=len)
    return seat(0, frozenset())
