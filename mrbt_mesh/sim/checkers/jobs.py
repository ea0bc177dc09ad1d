"""I10: no acknowledged command is lost or replaced by an older one, no step of a job that has ended
or is held begins, and no job expires early.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from itertools import product

from mrbt_mesh.core.agent.effects import Effect, StartAction
from mrbt_mesh.core.agent.view import AgentView
from mrbt_mesh.core.agent.wall_clock import READ_AGAIN_US, TOLERANCE_US
from mrbt_mesh.core.bt.activation import parse_activation
from mrbt_mesh.core.facts.records import (
    JOB,
    JOB_END,
    OPERATORS,
    FirstCommand,
    Hold,
    Job,
    JobState,
    OperatorCommand,
)
from mrbt_mesh.core.facts.store import Entry, Version
from mrbt_mesh.sim.checkers.findings import RunFindings, is_connected, joined
from mrbt_mesh.sim.world.journal import Changes
from mrbt_mesh.sim.world.process import SimProcess


class KeptJobs:
    """A command is acknowledged once a majority of the journals holds it. A job counts as lost if
    all that are there know nothing of it, though a robot is there whose journal has held it ever
    since; so does a change if a robot has an older one.

    The wall clock of one robot may be wrong: it must not make jobs due or expired too early, unless
    it hears no other robot.
    """

    def __init__(self, run: RunFindings) -> None:
        self._run = run
        self._majority = len(run.world.mission.robots) // 2 + 1
        # By job: the robots whose journals hold it, or its end.
        self._holders: dict[str, set[str]] = {}
        self._acknowledged: set[str] = set()
        # By entry and version of a command: the robots whose journals hold it; and those versions
        # that are acknowledged, the newest by entry.
        self._keepers: dict[tuple[str, Version], set[str]] = {}
        self._in_force: dict[str, Version] = {}
        # What robots have begun: (robot, activation).
        self._begun: set[tuple[str, str]] = set()
        self._ended: dict[SimProcess, set[str]] = {}
        # By job: its deadline and the time before which it must not begin, by submission.
        self._times: dict[str, list[Job]] = {}
        self._due: dict[SimProcess, set[str]] = {}

    def synced(self, process: SimProcess, changes: Changes) -> None:
        """A process has put this on its disk."""
        for entry in changes.values():
            command = entry.record if entry is not None else None
            if entry is not None and isinstance(command, OperatorCommand):
                self._kept(process, entry, command)
            if entry is not None and entry.parts[0] in (JOB, JOB_END):
                holders = self._holders.setdefault(entry.parts[1], set())
                holders.add(process.robot)
                if len(holders) >= self._majority:
                    self._acknowledged.add(entry.parts[1])

    def _kept(self, process: SimProcess, entry: Entry, command: OperatorCommand) -> None:
        if isinstance(command.value, Job):
            self._times.setdefault(entry.parts[1], []).append(command.value)
        keepers = self._keepers.setdefault((entry.name, entry.version), set())
        keepers.add(process.robot)
        if len(keepers) >= self._majority and not isinstance(command, FirstCommand):
            before = self._in_force.get(entry.name, entry.version)
            self._in_force[entry.name] = max(before, entry.version)

    def lost_journal(self, robot: str) -> None:
        for keepers in self._keepers.values():
            keepers.discard(robot)
        for holders in self._holders.values():
            holders.discard(robot)

    def handled(self, process: SimProcess, agent: AgentView, effects: Iterable[Effect]) -> None:
        """After a step."""
        jobs = agent.facts.jobs
        if jobs is None:
            return
        for effect in effects:
            if isinstance(effect, StartAction):
                job = parse_activation(effect.activation).job
                if job:
                    self._run.checks["I10"] += 1
                if job and jobs.has_ended(job):
                    text = f"{agent.robot} starts {effect.activation}, a job that has ended"
                    self._run.violation("I10", text)
                begun = (agent.robot, effect.activation)
                if begun not in self._begun and jobs.hold_of(job) is not Hold.RELEASED:
                    text = f"{agent.robot} starts {effect.activation}, of a job that is held"
                    self._run.violation("I10", text)
                self._begun.add(begun)
        before = self._ended.setdefault(process, set())
        due = self._due.setdefault(process, set())
        for known in jobs:
            end, name = known.ends.get(agent.robot), known.id
            if end is not None and end.state is JobState.EXPIRED and name not in before:
                self._not_too_early(agent, name, "expired", lambda job: job.deadline_us)
            if agent.robot in known.due and name not in due:
                due.add(name)
                self._not_too_early(agent, name, "due", lambda job: job.not_before_us)
        for name in sorted(before):
            if not jobs.has_ended(name):
                self._run.violation(
                    "I10", f"for {agent.robot} the job {name} has not ended any more"
                )
        before.clear()
        before.update(known.id for known in jobs if known.written_end)

    def _not_too_early(
        self, agent: AgentView, name: str, what: str, time_of: Callable[[Job], int]
    ) -> None:
        world = self._run.world
        now_us = world.setup.launch_unix_us + world.clock.now_us
        times_us = [time_of(job) for job in self._times.get(name, ()) if time_of(job)]
        if not times_us or len(agent.alive()) < 2:
            return
        self._run.checks["I10"] += 1
        if now_us + TOLERANCE_US + READ_AGAIN_US < min(times_us):
            early_s = (min(times_us) - now_us) / 1e6
            self._run.violation("I10", f"{agent.robot}: the job {name} is {what} {early_s} s early")

    def sample(self) -> None:
        run, world = self._run, self._run.world
        agents = joined(world)
        now_us, healed_us = world.clock.now_us, world.healed_us
        if not self._acknowledged or healed_us is None or not run.is_tolerable:
            return
        if now_us - max(healed_us, run.fault_us) <= run.settling_us:
            return
        if len(agents) < len(world.living()) or not is_connected(agents, world.network.blocked):
            return
        present = {agent.robot for agent in agents}
        for agent, (name, version) in product(agents, sorted(self._in_force.items())):
            run.checks["I10"] += 1
            entry = agent.facts.map.get(OPERATORS, name)
            is_older = entry is not None and entry.version < version
            if is_older and self._keepers[name, version] & present:
                run.violation("I10", f"{agent.robot} has an older {name} than was acknowledged")
        for name in sorted(self._acknowledged):
            run.checks["I10"] += 1
            for agent in agents:
                jobs = agent.facts.jobs
                assert jobs is not None
                is_known = name in jobs.known or jobs.is_archived(name)
                if not is_known and self._holders[name] & present:
                    run.violation("I10", f"{agent.robot} has lost the job {name}")
