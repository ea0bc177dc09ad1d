"""The team: starts its processes and ends them. Computers' clocks and journals outlive both."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, Protocol

from mrbt_mesh.core.agent.agent import Agent
from mrbt_mesh.core.agent.config import AgentConfig, ResumedLife
from mrbt_mesh.core.mission.mission import Robot
from mrbt_mesh.runtime.actions import RobotIdentity
from mrbt_mesh.sim.world.clock import LocalClock
from mrbt_mesh.sim.world.journal import FULL, SimJournal
from mrbt_mesh.sim.world.process import SimProcess, Surroundings

FIRST_PID = 1_000


class TeamSurroundings(Surroundings, Protocol):
    """The world, as far as the team has to do with it."""

    def launched(self, process: SimProcess) -> None: ...
    def killed(self, process: SimProcess) -> None: ...


class Robots:
    """The robots' processes, one life after the other; `processes`: robot -> its latest one;
    `lives`: the number of that, and `descriptions`: the robot as its mission had it then.

    `to_launch`: how many of the first ones are still to come.
    """

    def __init__(self, world: TeamSurroundings) -> None:
        setup = world.setup
        self.processes: dict[str, SimProcess] = {}
        self.descriptions: dict[str, Robot] = {}
        self.to_launch = len(setup.robots)
        self._setup = setup
        self._world = world
        self._bus = world.bus
        self.lives: dict[str, int] = {}
        self._lives = 0
        # Robots that were killed before they had a process.
        self._never: set[str] = set()
        # After how many more actions a robot is killed.
        self._actions_left: dict[str, int] = {}
        self._journals: dict[str, SimJournal] = {}
        self._clocks: dict[str, LocalClock] = {}
        self._start_program: Callable[[SimProcess], object] | None = None
        if setup.begin is not None:
            for robot in setup.mission.robots:
                journal = self._journals[robot] = SimJournal()
                journal.write({(e.author, e.name): e for e in setup.begin.facts})

    def living(self) -> list[SimProcess]:
        """Processes that run and are not frozen, sorted by robot."""
        return [process for _, process in sorted(self.processes.items()) if process.runs]

    def is_coming(self, robot: str) -> bool:
        """Whether its process is about to start, or is starting."""
        process = self.processes.get(robot)
        if process is None:
            return robot in self._setup.robots and robot not in self._never
        return process.agent is None and not process.is_over

    def is_known(self, robot: str) -> bool:
        """Whether it can be started: the mission has it, or that in force."""
        return robot in self._setup.mission.robots or robot in self._world.mission.robots

    def local_clock(self, robot: str) -> LocalClock:
        """The clock of this robot's computer."""
        return self._clocks.setdefault(
            robot, LocalClock(self._bus.clock, self._setup.launch_unix_us)
        )

    # -- starting -----------------------------------------------------------------------------

    def launch_all(self, start_program: Callable[[SimProcess], object]) -> None:
        """Start the team within a short time; `start_program` runs a process."""
        self._start_program = start_program
        for robot in self._setup.robots:
            offset = self._random_bytes("start", robot)
            spread_us = 0 if self._setup.begin is not None else self._setup.start_spread_us
            at_us = int.from_bytes(offset, "big") % (spread_us + 1)
            self._bus.clock.at(at_us, partial(self._launch_first, robot))

    def _launch_first(self, robot: str) -> None:
        self.to_launch -= 1
        if robot not in self._never:
            life = begin.lives[robot] if (begin := self._setup.begin) is not None else None
            self.launch(robot, keeps_journal=True, life=life)

    def launch(self, robot: str, keeps_journal: bool, life: ResumedLife | None = None) -> None:
        """Start a process of this robot, with what its journal kept or without."""
        self._lives += 1
        self.lives[robot] = self._lives
        if robot not in self._journals or not keeps_journal:
            self._journals[robot] = SimJournal()
            self._world.inspection.lost_journal(robot)
        journal = self._journals[robot]
        setup = self._setup
        # One that a revision has added starts with that.
        mission = setup.mission if robot in setup.mission.robots else self._world.mission
        description = self.descriptions[robot] = mission.robots[robot]
        pid = FIRST_PID + self._lives
        own = tuple(sorted(description.capabilities))
        identity = RobotIdentity(robot, description.type, pid, setup.speed, own, is_virtual=True)
        config = self._config(identity, description.capabilities, journal, life)

        def make_agent(now_us: int) -> Agent:
            self._bus.tell_tokens(robot)
            return Agent(mission, config, now_us)

        local = self.local_clock(robot)
        process = SimProcess(self._world, mission, identity, journal, local, make_agent)
        self.processes[robot] = self._bus.endpoints[robot] = process
        assert self._start_program is not None
        self._start_program(process)
        self._world.launched(process)

    def restart(self, robot: str, keeps_journal: bool) -> None:
        """End this robot's process, if there is one, and start another."""
        self.kill(robot)
        self.launch(robot, keeps_journal)

    def change_disk(self, robot: str, sync_us: int, fails: bool, is_locked: bool) -> None:
        """What the disk of a robot is like from now on, for this process and those after it."""
        journal = self._journals.setdefault(robot, SimJournal())
        journal.sync_us, journal.fails, journal.is_locked = sync_us, fails, is_locked

    def _config(
        self,
        identity: RobotIdentity,
        capabilities: Mapping[str, int],
        journal: SimJournal,
        life: ResumedLife | None,
    ) -> AgentConfig:
        setup, robot, options = self._setup, identity.robot, self._setup.agents
        nonce = self._random_bytes("nonce", robot, self._lives).hex()
        return AgentConfig(
            robot=robot,
            type=identity.type,
            capabilities=dict(capabilities),
            run=setup.run,
            nonce=nonce if life is None else life.version.incarnation.nonce,
            solver=options.solvers.get(robot, options.solver),
            timing=setup.timing,
            expected=frozenset(setup.robots),
            exit_when_done=options.exit_when_done,
            software="simulator",
            restored=() if journal.is_locked else journal.read(),
            journal_problem=FULL if journal.is_locked or journal.fails else "",
            host=f"computer of {robot}",
            pid=identity.pid,
            engine=options.engine,
            plans_apart=options.plan_delay_us is not None,
            keys=options.keys.get(robot),
            life=self._lives,
            resumed=life,
        )

    def _random_bytes(self, *purpose: Any) -> bytes:
        text = "/".join(map(str, (self._setup.seed, *purpose)))
        return hashlib.blake2b(text.encode(), digest_size=4).digest()

    # -- ending -------------------------------------------------------------------------------

    def kill(self, robot: str) -> None:
        """End this robot's process, or the first one before it has begun."""
        process = self.processes.get(robot)
        if process is None:
            self._never.add(robot)  # it dies before its first message
        elif not process.is_over:
            process.kill()
            self._world.killed(process)
            self._bus.withdraw(robot)

    def kill_after(self, robot: str, actions: int) -> None:
        """End this robot's process once it has reported how `actions` more of its actions ended."""
        self._actions_left[robot] = actions

    def completed(self, robot: str) -> None:
        """A robot has reported the end of one of its actions."""
        if robot in self._actions_left:
            self._actions_left[robot] -= 1
            if not self._actions_left[robot]:
                del self._actions_left[robot]
                self._bus.clock.at(self._bus.clock.now_us, partial(self.kill, robot))
