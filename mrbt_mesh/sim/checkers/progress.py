"""I6: what can be finished is finished."""

from __future__ import annotations

import contextlib
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence

from mrbt_mesh.core.agent.effects import Effect, Persist, Stop
from mrbt_mesh.core.agent.inputs import ActionFinished, Input
from mrbt_mesh.core.agent.view import AgentView
from mrbt_mesh.core.bt.activation import parse_activation
from mrbt_mesh.core.bt.evaluation import Request
from mrbt_mesh.core.bt.tree import Kind
from mrbt_mesh.core.facts.activation_facts import PARTY_KINDS
from mrbt_mesh.core.facts.records import (
    Attempt,
    ConditionValue,
    Hold,
    Latch,
    Member,
    Outcome,
    TeamOrder,
)
from mrbt_mesh.core.facts.store import Entry, Incarnation
from mrbt_mesh.core.facts.team_facts import TeamFacts, capability
from mrbt_mesh.core.feature import features, used
from mrbt_mesh.core.mission.mission import (
    MICRO,
    Mission,
    MissionEnd,
    Need,
    performance,
)
from mrbt_mesh.sim.checkers.barriers import lacked
from mrbt_mesh.sim.checkers.findings import RunFindings, is_connected, joined
from mrbt_mesh.sim.checkers.finishing import can_finish
from mrbt_mesh.sim.checkers.work import OVER


class Progress:
    """I6: after the last fault all robots join, and the mission goes on while a request can be met.

    `is_settled`: nothing more will come of the run: the mission is over, or no request can be met,
    or it is one that may go on for ever. `done_twice` counts the successes of a local task beyond
    mu, which a partition or a crash may cause if the task is not exclusive.
    """

    def __init__(self, run: RunFindings) -> None:
        self._run = run
        self._progress_us = 0
        declared = [robot.capabilities for robot in run.world.mission.robots.values()]
        self._longest_us = longest_us(run.world.mission, run.world.speed, declared)
        # One that was cancelled may first have to turn round.
        self._ways_us = round(2 * _longest_way_us(run.world.mission) / run.world.speed)
        self.is_endless = is_endless(run.world.mission)
        self._done: set[tuple[object, ...]] = set()
        self._successes: Counter[tuple[int, str, str]] = Counter()
        self.is_settled = False

    @property
    def done_twice(self) -> int:
        counts = self._successes.items()
        return sum(max(0, count - most) for (most, _, _), count in counts)

    def handled(self, agent: AgentView, effects: Iterable[Effect]) -> None:
        world = self._run.world
        for effect in effects:
            is_end = isinstance(effect, Stop) and effect.reason.startswith("mission ")
            stands_by = world.mission.ends is MissionEnd.NEVER
            if is_end and stands_by and agent.facts.order() is not TeamOrder.ABORT:
                self._run.violation("I6", f"{agent.robot} stopped, but the mission never ends")
            for entry in effect.entries if isinstance(effect, Persist) and effect.at_once else ():
                if self._is_progress(entry):
                    self._progress_us = world.clock.now_us
                if isinstance(entry.record, Member):  # it may be slower than any was before
                    able = entry.record.capabilities
                    longest = longest_us(world.mission, world.speed, [able])
                    self._longest_us = max(self._longest_us, longest)

    def _is_progress(self, entry: Entry) -> bool:
        """Whether an entry is new work: not a party that forms, breaks or repeats another's."""
        kind, *scope = entry.parts
        if isinstance(entry.record, Outcome):
            done = (entry.author, *scope[:2], entry.record.success)
            is_new = done not in self._done
            self._done.add(done)
            return is_new
        kinds = (Attempt, Latch, ConditionValue)
        return isinstance(entry.record, kinds) and kind not in PARTY_KINDS

    def finishing(self, agent: AgentView, event: Input) -> None:
        """Before a step: an action is about to end."""
        action = agent.action
        if not isinstance(event, ActionFinished) or action is None or action.travel_to:
            return
        if not action.global_task:
            return  # without contact, alone
        if action.ticket == event.ticket:
            need = agent.facts.task(action.activation).need(action.local_task)
            most = need.max_robots if need is not None else 0
            self._successes[most, action.local_task, action.activation] += event.success

    def sample(self) -> None:
        run, world = self._run, self._run.world
        healed_us, now_us = world.healed_us, world.clock.now_us
        if healed_us is None or not run.is_tolerable:
            return
        agents = joined(world)
        if len(agents) < len(world.living()):
            self._check_joining(agents)
            return
        if not agents or not is_connected(agents, world.network.blocked):
            return
        if not run.checks["I6"] and servable(agents[0], agents[0].alive()):
            run.checks["I6"] += 1
        quiet_us = now_us - max(healed_us, run.fault_us)
        still_us = min(quiet_us, now_us - self._progress_us)
        patience_us = self._patience_us
        if still_us <= run.settling_us:
            self.is_settled = self.is_endless and quiet_us > patience_us
            return
        if all(agent.plan and agent.plan.result in OVER for agent in agents):
            # Where the team stands by, sensors may ask for more.
            self.is_settled = world.mission.ends is MissionEnd.ONCE or quiet_us > patience_us
            return
        if still_us <= patience_us:
            return
        exclusive = world.mission.has_tasks_at_most_once
        if exclusive and run.may_lack_grants:
            self.is_settled = True
            return
        for agent in agents:
            waits = agent.waits_for_deadline
            request = servable(agent, agent.alive())
            if request is None and (waits or agent.facts.order() is TeamOrder.PAUSE):
                return
            could = f"{request} could be served" if request else "the mission could be finished"
            if request is not None or can_finish(agent, agent.alive()):
                text = f"for {agent.robot}, {could}, but nothing was finished "
                run.violation("I6", text + f"for {still_us / 1e6:.1f} s after the last fault")
                self.is_settled = True
        self.is_settled = True

    def _check_joining(self, agents: Sequence[AgentView]) -> None:
        """All living robots join within some time."""
        run, world = self._run, self._run.world
        waits_us = world.clock.now_us - max(world.healed_us or 0, run.fault_us)
        if waits_us > 2 * run.settling_us:
            late = {process.robot for process in world.living()} - {agent.robot for agent in agents}
            text = f"{', '.join(sorted(late))} did not join within {waits_us / 1e6:.1f} s"
            run.violation("I6", f"{text} after the last fault")
            self.is_settled = True

    def never_stopped(self) -> None:
        """The mission has been over for long: all robots should have stopped."""
        names = ", ".join(process.robot for process in self._run.world.living())
        if names:
            self._run.violation("I6", f"the mission is over, but {names} did not stop")

    @property
    def _patience_us(self) -> int:
        """How long robots with work to do may finish nothing."""
        return 2 * self._run.settling_us + self._longest_us + self._ways_us

    def timed_out(self) -> None:
        """The run ended without a result: that is a violation if idle robots could have gone on."""
        world = self._run.world
        agents = [p.agent.view for p in world.living() if p.agent is not None]
        if not agents or world.network.blocked or world.healed_us is not None:
            return
        still_us = world.clock.now_us - max(self._progress_us, self._run.fault_us)
        if any(agent.action for agent in agents) or still_us <= self._patience_us:
            return
        if all(agent.plan and agent.plan.result in OVER for agent in agents):
            return  # they stand by
        if can_finish(agents[0], {agent.robot: agent.incarnation for agent in agents}):
            text = "the living robots could finish the mission, but nothing was finished for"
            self._run.violation("I6", f"{text} {still_us / 1e6:.1f} s")


def is_endless(mission: Mission) -> bool:
    """Whether something in the tree may repeat for ever."""
    nodes = mission.tree.nodes
    return any(n.kind is Kind.KEEP_RUNNING_UNTIL_FAILURE or n.limit < 0 for n in nodes)


def longest_us(mission: Mission, speed: float, capabilities: Iterable[Mapping[str, int]]) -> int:
    """How long the slowest of these robots takes for the longest local task of the mission."""
    robots = list(capabilities)
    longest = 0
    for task in mission.all_tasks():
        for need in task.needs:
            work = mission.nominal_work(need.local_task)
            able = (performance(each, need.local_task) for each in robots)
            for value in filter(None, able):
                longest = max(longest, work * MICRO // value)
    return round(longest / speed)


def _longest_way_us(mission: Mission) -> int:
    """How long the slowest robot takes from one place of a task or robot to another, at most."""
    travel, longest_ms = mission.travel, 0
    if travel is None:
        return 0
    of_jobs = {place for kind in mission.jobs.values() for _, place in kind.places()}
    goals = sorted({*travel.at.values(), *of_jobs})
    for robot in mission.robots.values():
        for origin in [*goals, travel.start.get(robot.id, "")]:
            for goal in goals:
                with contextlib.suppress(KeyError):  # no robot of its type needs that way
                    longest_ms = max(longest_ms, travel.way_ms(robot.type, origin, goal))
    return 1_000 * longest_ms


def servable(agent: AgentView, alive: Mapping[str, Incarnation]) -> str | None:
    """A request of T_G that the living could serve if it were the only one, None if there is none.

    Found by trying every assignment, without the planner.
    """
    facts = agent.facts
    if facts.order() is not TeamOrder.RESUME:
        return None
    for request in agent.mission.evaluator.evaluate(facts).requests:
        if not _is_excepted(facts, request, alive) and _can_serve(facts, request, alive):
            return request.activation
    return None


def _is_excepted(facts: TeamFacts, request: Request, alive: Mapping[str, Incarnation]) -> bool:
    """Whether a task waits for the blackboard, for an operator, or, if it is done at most once, for
    a living majority.
    """
    job = parse_activation(request.activation).job
    if job and facts.jobs is not None and facts.jobs.hold_of(job) is not Hold.RELEASED:
        return True
    task = facts.mission.global_tasks[request.subject]
    if task.reads and None in facts.values_read(request.activation, task):
        return True
    if any(feature.awaits_operator(facts, request) for feature in features()):
        return True
    present = sum(robot in facts.mission.robots for robot in alive)
    return task.at_most_once and 2 * present <= len(facts.mission.robots)


def _did(facts: TeamFacts, robot: str, request: Request, need: Need) -> bool:
    """Whether the robot has done what `same_robot_as` asks for, in the same job."""
    before, job = need.same_robot_as, parse_activation(request.activation).job
    assert before is not None
    return any(
        said.activation.job == job
        and said.activation.subject == before.global_task
        and facts.results(name, before.local_task).get(robot, False)
        for name, said in facts.activations.items()
    )


def _can_serve(facts: TeamFacts, request: Request, alive: Mapping[str, Incarnation]) -> bool:
    slots: list[tuple[list[str], str]] = []
    task = facts.mission.global_tasks[request.subject]
    for need in task.needs:
        results = facts.results(request.activation, need.local_task)
        if task.joint is not None:  # one coalition does all of it, without robots that have failed
            results = {robot: False for robot, success in results.items() if not success}
        able = []
        for robot, incarnation in sorted(alive.items()):
            known = facts.members.get(robot)
            if known is None or known[1] != incarnation or known[0].is_leaving:
                continue
            if robot in results or lacked(facts, request.activation, robot):
                continue
            did_before = need.same_robot_as is None or _did(facts, robot, request, need)
            if did_before and capability(known[0], need.local_task) is not None:
                able.append(robot)
        slots += [(able, need.local_task)] * max(0, need.min_robots - sum(results.values()))
    slots.sort(key=lambda slot: len(slot[0]))
    limits = list(used(facts.mission.sections))

    def seat(number: int, doers: Mapping[str, str]) -> bool:
        if not all(feature.allows(section, doers) for feature, section in limits):
            return False
        if number == len(slots):
            return True
        able, local_task = slots[number]
        return any(seat(number + 1, {**doers, r: local_task}) for r in able if r not in doers)

    return seat(0, {})
