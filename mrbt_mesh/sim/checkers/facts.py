"""I2: facts converge. I3: nothing that is done is undone. I8: garbage changes nothing."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence

from mrbt_mesh.core.agent.effects import StartAction, Stop
from mrbt_mesh.core.agent.inputs import Input, TimerFired
from mrbt_mesh.core.agent.view import AgentView
from mrbt_mesh.core.bt.activation import parse_activation
from mrbt_mesh.core.bt.tree import Status
from mrbt_mesh.core.facts.records import (
    DONE,
    Outcome,
    split_name,
)
from mrbt_mesh.core.facts.store import Entry, FactMap, join
from mrbt_mesh.core.facts.validation import ACTIVATION_KINDS
from mrbt_mesh.sim.checkers.findings import RunFindings, is_connected, joined
from mrbt_mesh.sim.world.process import SimProcess


class Convergence:
    """I2: once no message is lost, everybody holds what anybody held, within a bounded time.

    Also while new facts are written all the time; and where none is, all facts and views of
    who is alive are equal.
    """

    def __init__(self, findings: RunFindings) -> None:
        self._findings = findings
        self._noted_us = 0
        self._noted: FactMap | None = None
        self._holders: list[AgentView] = []

    def at_rest(self, agents: Sequence[AgentView]) -> None:
        """For long nothing was written, and there was no fault."""
        self._findings.checks["I2"] += 1
        digests = {agent.facts.map.digest() for agent in agents}
        if len(digests) > 1:
            names = ", ".join(f"{a.robot}={a.facts.map.digest().hex()[:8]}" for a in agents)
            self._findings.say("I2", f"facts still differ: {names}")

    def check_views(self, agents: Sequence[AgentView]) -> bool:
        """There was no fault for long: whether all agree that they are alive, and nobody else."""
        alive = {agent.robot: agent.incarnation for agent in agents}
        if any(agent.alive() != alive for agent in agents):
            views = "; ".join(f"{a.robot}: {' '.join(sorted(a.alive()))}" for a in agents)
            known = " ".join(alive)
            self._findings.say("I2", f"views of who is alive still differ from {known}: {views}")
            return False
        return True

    def declared_dead(self, agent: AgentView, robot: str) -> None:
        """The agent declares `robot` dead: not while somebody in between hears it well."""
        findings, world = self._findings, self._findings.world
        since_us = world.clock.now_us - findings.failure_latch_us - findings.repair_us
        if not findings.is_tolerable or findings.other_us > since_us:
            return

        def steady(source: str, target: str) -> bool:
            link = (source, target)
            changed_us = findings.cut_us.get(link, since_us)
            return link not in world.network.blocked and changed_us <= since_us

        present = [each.robot for each in joined(world)]
        if robot not in present:
            return
        findings.checks["I2"] += 1
        if steady(robot, agent.robot):
            findings.say("I2", f"{agent.robot} holds {robot} for dead, which it hears")
        for other in present:
            if (
                other not in (agent.robot, robot)
                and steady(robot, other)
                and steady(other, agent.robot)
            ):
                findings.say("I2", f"{agent.robot} holds {robot} for dead, which {other} hears")

    def sample(self, agents: list[AgentView]) -> None:
        """While facts keep coming: what anybody held a while ago has reached everybody."""
        findings, now_us = self._findings, self._findings.world.clock.now_us
        connected = is_connected(agents, findings.world.network.blocked)
        if not findings.is_tolerable or not connected or not agents:
            self._noted = None
            return
        period_us = 2 * findings.repair_us + findings.failure_latch_us
        if self._noted is None or findings.fault_us > self._noted_us:
            self._note(agents, now_us)
        elif now_us > self._noted_us + period_us:
            for agent in agents:
                if any(agent is holder for holder in self._holders):
                    self._check(agent, self._noted)
            self._note(agents, now_us)

    def _note(self, agents: Sequence[AgentView], now_us: int) -> None:
        self._noted_us, self._holders = now_us, list(agents)
        self._noted = FactMap()
        for agent in agents:
            self._noted.merge(agent.facts.map)

    def _check(self, agent: AgentView, noted: FactMap) -> None:
        self._findings.checks["I2"] += 1
        for entry in noted:
            if not stands(agent, entry) and not is_obsolete(agent, entry):
                text = f"{agent.robot} still lacks {entry.name} {entry.version} of {entry.author}"
                self._findings.say("I2", text)


def stands(agent: AgentView, entry: Entry) -> bool:
    """Whether the agent holds this entry, or one that goes before it."""
    mine = agent.facts.map.get(entry.author, entry.name)
    if mine is None:
        return False
    newest = join(mine, entry)
    return (newest.version, newest.packed) == (mine.version, mine.packed)


def is_obsolete(agent: AgentView, entry: Entry) -> bool:
    """Whether the agent may have dropped this entry, because nothing can reach it any more."""
    parts = entry.parts
    if parts[0] not in ACTIVATION_KINDS:
        return False
    return agent.mission.evaluator.is_obsolete(parse_activation(parts[1]), agent.facts)


class NothingUndone:
    """I3: a process never loses an outcome, and what is finished stays finished: global tasks, and
    the mission. Robots that have always heard one another stop with the same result.
    """

    def __init__(self, findings: RunFindings) -> None:
        self._findings = findings
        self._outcomes: dict[SimProcess, dict[tuple[str, str], bool]] = {}
        self._finished: dict[SimProcess, set[str]] = {}
        self._seen: dict[SimProcess, tuple[int, int]] = {}
        self._ended: dict[SimProcess, Status] = {}
        self._stopped: dict[str, str] = {}

    def started(self, agent: AgentView, start: StartAction) -> None:
        if agent.facts.task_status(start.global_task, start.activation) is not Status.RUNNING:
            text = f"{agent.robot} starts {start.activation}, which it knows to be over"
            self._findings.say("I3", text)
        if agent.facts.result(agent.alive()) is not None:
            text = f"{agent.robot} starts {start.activation}, but knows that the mission has ended"
            self._findings.say("I3", text)

    def stopped(self, agent: AgentView, stop: Stop) -> None:
        if not stop.reason.startswith("mission "):
            return
        for other, reason in self._stopped.items():
            if reason != stop.reason and not self._findings.world.cut_off:
                text = f"{agent.robot} stops with {stop.reason}, {other} has with {reason}"
                self._findings.say("I3", text)
        self._stopped[agent.robot] = stop.reason

    def check(self, process: SimProcess, agent: AgentView) -> None:
        """After a step, or at a sample: cheap while nothing has changed."""
        facts, evaluator = agent.facts, agent.mission.evaluator
        seen = (facts.outcome_changes, len(facts.map))
        if self._seen.get(process) == seen:
            return
        self._seen[process] = seen
        self._check_end(process, agent)
        now = {
            (entry.author, entry.name): entry.record.success
            for entry in facts.map
            if isinstance(entry.record, Outcome)
        }
        for key, success in self._outcomes.get(process, {}).items():
            if now.get(key, False) < success or key not in now:
                robot, name = key
                if not evaluator.is_obsolete(parse_activation(split_name(name)[1]), facts):
                    self._findings.say("I3", f"{agent.robot} has lost {name} of {robot}")
        self._outcomes[process] = now
        self._findings.checks["I3"] += len(now)
        finished = self._finished.setdefault(process, set())
        begun = {name for name, said in facts.activations.items() if said.has_outcome}
        for activation in sorted(finished | begun):
            scope = parse_activation(activation)
            if facts.task_status(scope.subject, activation) is Status.SUCCESS:
                if activation not in finished:
                    finished.add(activation)
                    self._check_round(agent, scope.subject, activation, now)
            elif activation in finished:
                finished.discard(activation)
                if not evaluator.is_obsolete(scope, facts):
                    text = f"for {agent.robot} {activation} is not finished any more"
                    self._findings.say("I3", text)

    def _check_end(self, process: SimProcess, agent: AgentView) -> None:
        """What most robots have agreed on is the mission's result, unless success comes later."""
        result, before = agent.facts.result(agent.mission.robots), self._ended.get(process)
        if before is not None and result not in (before, Status.SUCCESS):
            self._findings.say("I3", f"for {agent.robot} the mission has not ended any more")
        if result is not None:
            self._findings.checks["I3"] += 1
            self._ended[process] = result

    def _check_round(
        self,
        agent: AgentView,
        task_id: str,
        activation: str,
        outcomes: Mapping[tuple[str, str], bool],
    ) -> None:
        """I4 for what coalitions do: nu successes of one coalition, or the operator's word."""
        task = agent.mission.global_tasks[task_id]
        if not task.by_coalition:
            return
        rounds: dict[str, Counter[str]] = {}
        for (_, name), success in outcomes.items():
            _, where, local_task, token = split_name(name) if name.count("/") == 3 else ("",) * 4
            if success and where == activation:
                rounds.setdefault(token, Counter())[local_task] += 1
        enough = (all(r[n.local_task] >= n.min_robots for n in task.needs) for r in rounds.values())
        done = any(entry.name == f"{DONE}/{activation}" for entry in agent.facts.map)
        if not done and not any(enough):
            text = (
                f"for {agent.robot} {activation} is finished, but no coalition has done all of it"
            )
            self._findings.say("I4", text)


class GarbageChangesNothing:
    """I8: nothing malformed, foreign or forged stops an agent or leaves a trace."""

    def __init__(self, findings: RunFindings) -> None:
        self._findings = findings

    def arrives(self, process: SimProcess, event: Input) -> None:
        """Let garbage arrive, and see that nothing of it stays."""
        process.deliver(TimerFired())
        if process.runs and not process.is_slow:
            self._findings.checks["I8"] += 1
        before = _state(process)
        process.deliver(event)
        if before != _state(process):
            self._findings.say("I8", f"{process.robot} was changed by garbage {event!r:.200}")


def _state(process: SimProcess) -> tuple[object, ...]:
    agent = process.agent.view if process.agent is not None else None
    if agent is None:
        return (process.is_over,)
    return (
        process.is_over,
        agent.facts.map.digest(),
        {robot: peer.state for robot, peer in agent.peers.items()},
        agent.version,
        agent.claim,
        agent.lost,
    )
