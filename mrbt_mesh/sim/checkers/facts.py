"""I2: facts converge. I3: nothing that is done is undone. I8: garbage changes nothing."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence

from mrbt_mesh.core.agent.effects import StartAction, Stop
from mrbt_mesh.core.agent.inputs import Input, TimerFired
from mrbt_mesh.core.agent.view import AgentView
from mrbt_mesh.core.bt.activation import parse_activation
from mrbt_mesh.core.bt.tree import Status
from mrbt_mesh.core.facts.jobs import job_of
from mrbt_mesh.core.facts.records import (
    IN_ANY_MISSION,
    JOB_END,
    Outcome,
    split_name,
)
from mrbt_mesh.core.facts.store import Entry, FactMap, join
from mrbt_mesh.core.facts.team_facts import OF_JOBS, TeamFacts
from mrbt_mesh.core.facts.validation import (
    ACTIVATION_KINDS,
    believed,
    has_activation,
    no_place_reason,
)
from mrbt_mesh.sim.checkers.findings import RunFindings, is_connected, joined
from mrbt_mesh.sim.world.process import SimProcess


def no_difference(run: RunFindings, agents: Sequence[AgentView]) -> None:
    """I2: once nothing has been written for long, all facts are equal."""
    run.checks["I2"] += 1
    if len({agent.facts.map.digest() for agent in agents}) > 1:
        names = ", ".join(f"{a.robot}={a.facts.map.digest().hex()[:8]}" for a in agents)
        run.violation("I2", f"facts still differ: {names}")


def same_members(run: RunFindings, agents: Sequence[AgentView]) -> bool:
    """I2: once there has been no fault for long, these agents take exactly each other for alive."""
    alive = {agent.robot: agent.incarnation for agent in agents}
    if all(agent.alive() == alive for agent in agents):
        return True
    views = "; ".join(f"{a.robot}: {' '.join(sorted(a.alive()))}" for a in agents)
    run.violation("I2", f"views of who is alive still differ from {' '.join(alive)}: {views}")
    return False


def not_dead_but_heard(run: RunFindings, agent: AgentView, robot: str) -> None:
    """I2: nobody is declared dead whom the agent, or a robot that it hears, hears well."""
    since_us = run.world.clock.now_us - run.agreement_us - run.repair_us
    present = [each.robot for each in joined(run.world)]
    if not run.is_tolerable or run.other_us > since_us or robot not in present:
        return

    def steady(source: str, target: str) -> bool:
        link = (source, target)
        return link not in run.world.network.blocked and run.cut_us.get(link, 0) <= since_us

    run.checks["I2"] += 1
    if steady(robot, agent.robot):
        run.violation("I2", f"{agent.robot} holds {robot} for dead, which it hears")
    for other in present:
        if (
            other not in (agent.robot, robot)
            and steady(robot, other)
            and steady(other, agent.robot)
        ):
            run.violation("I2", f"{agent.robot} holds {robot} for dead, which {other} hears")


class Delivery:
    """I2: while no message is lost, every fact reaches everybody within a bounded time."""

    def __init__(self, run: RunFindings) -> None:
        self._run = run
        self._noted_us = 0
        self._noted: FactMap | None = None
        self._holders: list[AgentView] = []

    def sample(self, agents: list[AgentView]) -> None:
        run, now_us = self._run, self._run.world.clock.now_us
        connected = is_connected(agents, run.world.network.blocked)
        if not run.is_tolerable or not connected or not agents:
            self._noted = None
            return
        if self._noted is not None and run.fault_us <= self._noted_us:
            if now_us <= self._noted_us + 2 * run.repair_us + run.agreement_us:
                return
            for agent in agents:
                if any(agent is holder for holder in self._holders):
                    self._check(agent, self._noted)
        self._noted_us, self._holders, self._noted = now_us, list(agents), FactMap()
        for agent in agents:
            self._noted.merge(agent.facts.map)

    def _check(self, agent: AgentView, noted: FactMap) -> None:
        self._run.checks["I2"] += 1
        for entry in noted:
            if not stands(agent, entry) and not is_obsolete(agent, entry):
                text = f"{agent.robot} still lacks {entry.name} {entry.version} of {entry.author}"
                self._run.violation("I2", text)


def stands(agent: AgentView, entry: Entry) -> bool:
    """Whether the agent holds this entry, or one that wins over it."""
    mine = agent.facts.map.get(entry.author, entry.name)
    if mine is None:
        return False
    newest = join(mine, entry)
    return (newest.version, newest.packed) == (mine.version, mine.packed)


def is_revised_away(agent: AgentView, entry: Entry) -> bool:
    """Whether no revision can have a place for this entry any more."""
    facts, parts = agent.facts, entry.parts
    if parts[0] in IN_ANY_MISSION:
        return len(parts) > 1 and int(parts[1]) < facts.in_force.number
    if facts.in_force.succession is None:
        has_no_place = no_place_reason(entry, facts.in_force, facts.run) is not None
        return has_no_place and _knows_revisions(facts)
    return believed(entry, facts.in_force, facts.run) is None and facts.is_past(entry)


def _knows_revisions(facts: TeamFacts) -> bool:
    """Whether another mission was in force before, or may be soon."""
    return facts.in_force.succession is not None or any(
        entry.parts[0] in IN_ANY_MISSION for entry in facts.map
    )


def is_obsolete(agent: AgentView, entry: Entry) -> bool:
    """Whether the agent may have dropped this entry, since no evaluation can read it."""
    parts = entry.parts
    if is_revised_away(agent, entry):
        return True
    if parts[0] in IN_ANY_MISSION:
        return False
    jobs = agent.facts.jobs
    name = job_of(entry) if jobs is not None and parts[0] in OF_JOBS else ""
    if jobs is not None and name:
        return jobs.is_archived(name) or (parts[0] != JOB_END and jobs.is_settled(name))
    if parts[0] not in ACTIVATION_KINDS:
        return False
    activation = parse_activation(parts[1])
    # What it dropped before its job had ended, as out of reach, it does not need.
    has_ended = jobs is not None and bool(activation.job) and jobs.has_ended(activation.job)
    return has_ended or agent.facts.is_obsolete(activation)


def _is_gone(agent: AgentView, activation: str) -> bool:
    """Whether no evaluation can reach an activation, as of a node that a revision does not have."""
    facts = agent.facts
    is_known = has_activation(facts.in_force, activation, facts.run)
    if not is_known and _knows_revisions(facts):
        return True
    return facts.is_obsolete(parse_activation(activation))


class NothingUndone:
    """I3: a process never loses an outcome; global tasks and missions that are finished stay so.

    Robots that have always heard one another stop with the same result.
    """

    def __init__(self, run: RunFindings) -> None:
        self._run = run
        self._outcomes: dict[SimProcess, dict[tuple[str, str], bool]] = {}
        self._finished: dict[SimProcess, set[str]] = {}
        self._seen: dict[SimProcess, tuple[int, int]] = {}
        self._ended: dict[SimProcess, Status] = {}
        self._stopped: dict[str, str] = {}

    def started(self, agent: AgentView, start: StartAction) -> None:
        if agent.facts.task_status(start.global_task, start.activation) is not Status.RUNNING:
            text = f"{agent.robot} starts {start.activation}, which it knows to be over"
            self._run.violation("I3", text)
        if agent.facts.result(agent.alive()) is not None:
            text = f"{agent.robot} starts {start.activation}, but knows that the mission has ended"
            self._run.violation("I3", text)

    def stopped(self, agent: AgentView, stop: Stop) -> None:
        if not stop.reason.startswith("mission "):
            return
        for other, reason in self._stopped.items():
            if reason != stop.reason and not self._run.world.cut_off:
                text = f"{agent.robot} stops with {stop.reason}, {other} has with {reason}"
                self._run.violation("I3", text)
        self._stopped[agent.robot] = stop.reason

    def check(self, process: SimProcess, agent: AgentView) -> None:
        """After a step, or at a sample: cheap while nothing has changed."""
        facts = agent.facts
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
                if not _is_gone(agent, split_name(name)[1]):
                    self._run.violation("I3", f"{agent.robot} has lost {name} of {robot}")
        self._outcomes[process] = now
        self._run.checks["I3"] += len(now)
        finished = self._finished.setdefault(process, set())
        begun = {name for name, each in facts.activations.items() if each.has_outcome}
        for activation in sorted(finished | begun):
            scope = parse_activation(activation)
            if facts.task_status(scope.subject, activation) is Status.SUCCESS:
                if activation not in finished:
                    finished.add(activation)
                    self._check_round(agent, activation, now)
            elif activation in finished:
                finished.discard(activation)
                if not _is_gone(agent, activation):
                    text = f"for {agent.robot} {activation} is not finished any more"
                    self._run.violation("I3", text)

    def _check_end(self, process: SimProcess, agent: AgentView) -> None:
        """The mission's result is final, unless success follows failure."""
        result, before = agent.facts.result(agent.mission.robots), self._ended.get(process)
        if before is not None and result not in (before, Status.SUCCESS):
            self._run.violation("I3", f"for {agent.robot} the mission has not ended any more")
        if result is not None:
            self._run.checks["I3"] += 1
            self._ended[process] = result

    def _check_round(
        self,
        agent: AgentView,
        activation: str,
        outcomes: Mapping[tuple[str, str], bool],
    ) -> None:
        """I4 of coalitions: nu successes of one coalition, or the operator has ended the task."""
        task = agent.facts.task(activation)
        if task.joint is None:
            return
        rounds: dict[str, Counter[str]] = {}
        for (_, name), success in outcomes.items():
            _, where, local_task, token = split_name(name) if name.count("/") == 3 else ("",) * 4
            if success and where == activation:
                rounds.setdefault(token, Counter())[local_task] += 1
        enough = (all(r[n.local_task] >= n.min_robots for n in task.needs) for r in rounds.values())
        done = agent.facts.activations[activation].verdict is True
        if not done and not any(enough):
            text = f"for {agent.robot} {activation} is finished, but by no whole coalition"
            self._run.violation("I4", text)


def garbage_changes_nothing(run: RunFindings, process: SimProcess, event: Input) -> None:
    """I8: deliver something malformed, foreign or forged; the agent's state stays as it was."""
    process.deliver(TimerFired())
    if process.runs and not process.is_slow:
        run.checks["I8"] += 1
    before = _state(process)
    process.deliver(event)
    if before != _state(process):
        run.violation("I8", f"{process.robot} was changed by garbage {event!r:.200}")


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
