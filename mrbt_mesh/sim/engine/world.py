"""The simulated world: robots' processes, the network between them, faults, an observer."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import anyio
import anyio.abc

from mrbt_mesh.core.agent.agent import Agent
from mrbt_mesh.core.agent.config import AgentConfig
from mrbt_mesh.core.agent.effects import Ask, Publish, Reply
from mrbt_mesh.core.agent.inputs import (
    ActionFinished,
    AnswerReceived,
    Input,
    MessageReceived,
    QueryReceived,
    TokenChanged,
)
from mrbt_mesh.core.assignment.problem import Solver
from mrbt_mesh.core.assignment.solvers import default_solver
from mrbt_mesh.core.bt.tree import Status
from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.core.membership.timing import Timing
from mrbt_mesh.core.membership.wire import Header, MessageKind
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.core.observer.observer import Observer
from mrbt_mesh.runtime.actions import RobotIdentity
from mrbt_mesh.runtime.engine_choice import chosen_engine
from mrbt_mesh.runtime.program import RobotProgram
from mrbt_mesh.sim.engine import faults
from mrbt_mesh.sim.engine.clock import LocalClock, VirtualClock
from mrbt_mesh.sim.engine.failures import NO_FAILURES, FailureModel, Failures
from mrbt_mesh.sim.engine.injector import Injector
from mrbt_mesh.sim.engine.inspection import FullInspection, Inspection
from mrbt_mesh.sim.engine.journal import SimJournal
from mrbt_mesh.sim.engine.network import Network, NetworkKnobs
from mrbt_mesh.sim.engine.process import SimProcess
from mrbt_mesh.sim.engine.sharing import shared_engine

# How long, in detection times, robots that were cut off may outlive the end of the mission.
GIVE_UP_DETECTIONS = 5


@dataclass(frozen=True)
class Setup:
    """All that decides a run. `robots` are launched at the start, within `start_spread_us`.

    With `plan_delay_us` plans are made outside of the agents, and take so long. `speed` shortens
    the robots' work. `timeout_us` counts from the launch. `inspect`: check what
    must always hold, and log every effect. `stop_when_stuck`: end a run of which nothing more
    will come. `solvers` are those of robots that have another one than `solver`. `failures`
    befall the team besides the faults of the `schedule`.
    """

    mission: Mission
    program: RobotProgram
    seed: int
    robots: tuple[str, ...]
    timeout_us: int
    schedule: tuple[tuple[int, faults.Fault], ...] = ()
    network: NetworkKnobs = field(default_factory=NetworkKnobs)
    timing: Timing = field(default_factory=Timing)
    solver: Solver = default_solver
    solvers: Mapping[str, Solver] = field(default_factory=dict)
    speed: float = 1.0
    exit_when_done: bool = True
    stop_when_stuck: bool = False
    failures: FailureModel = NO_FAILURES
    start_spread_us: int = 20_000
    plan_delay_us: int | None = None
    inspect: bool = True
    keep_log: bool = False


@dataclass(slots=True)
class _Question:
    """A query on its way: who asked whom; the answer comes once."""

    asker: SimProcess
    peer: str
    answered: bool = False


class World:
    """Everything that is there, and what happens when. One instance is one run.

    `gave_up`: robots outlived the end of the mission. `healed_us`: when all faults ended.
    """

    def __init__(self, setup: Setup) -> None:
        self.setup = setup
        self.clock = VirtualClock()
        self.network = Network(setup.network, setup.seed)
        self.run = f"sim{setup.seed}"
        header = Header(setup.mission.digest[:16], setup.mission.name, self.run, "")
        # What is checked must have been computed by each robot for itself.
        engine = chosen_engine()
        self._engine = engine if setup.inspect else shared_engine(header, engine)
        self.observer = Observer(
            setup.mission, self.run, setup.timing, default_solver, self._engine
        )
        self.inspection = FullInspection(self, setup.keep_log) if setup.inspect else Inspection()
        self.processes: dict[str, SimProcess] = {}
        self.events: list[dict[str, Any]] = []
        self.error: Exception | None = None
        self.over = anyio.Event()
        self.timed_out = False
        self.gave_up = False
        self.healed_us: int | None = None
        self._lives = 0
        self._questions: dict[int, _Question] = {}
        self._observing = False
        self.befallen: Counter[str] = Counter()
        self._stuck_since: tuple[int, int] = (0, 0)
        self._pending = len(setup.schedule)
        self._injector = Injector(self, header)
        self._failures = Failures(self, setup.failures)
        self._never: set[str] = set()
        self._actions_left: dict[str, int] = {}
        self._to_launch = len(setup.robots)
        self._journals: dict[str, SimJournal] = {}
        self._clocks: dict[str, LocalClock] = {}
        self._group: anyio.abc.TaskGroup | None = None

    async def main(self) -> None:
        """Run until the mission is over, nothing can happen any more, or the timeout."""
        self.clock.on_error = self._failed
        setup = self.setup
        async with anyio.create_task_group() as self._group:
            for robot in setup.robots:
                offset = self._random_bytes("start", robot)
                at_us = int.from_bytes(offset, "big") % (setup.start_spread_us + 1)
                self.clock.at(at_us, partial(self._launch_first, robot))
            for at_us, fault in sorted(setup.schedule, key=lambda item: item[0]):
                self.clock.at(at_us, partial(self._befall_scheduled, fault))
            self._failures.begin()
            self.clock.at(setup.timeout_us, self._time_out)
            self.clock.at(0, self._observe_regularly)
            await self.over.wait()
            self._group.cancel_scope.cancel()
        if self.error is not None:
            raise self.error

    @property
    def mission(self) -> Mission:
        return self.setup.mission

    @property
    def timing(self) -> Timing:
        return self.setup.timing

    @property
    def plan_delay_us(self) -> int:
        return self.setup.plan_delay_us or 0

    @property
    def solver(self) -> Solver:
        return default_solver

    @property
    def speed(self) -> float:
        return self.setup.speed

    @property
    def cut_off(self) -> bool:
        """Whether some robot could not hear all others in time for a while."""
        return self._injector.cut_off

    def living(self) -> list[SimProcess]:
        """Processes that run and are not frozen, sorted by robot."""
        return [
            self.processes[robot] for robot in sorted(self.processes) if self.processes[robot].runs
        ]

    def is_coming(self, robot: str) -> bool:
        """Whether its process is about to start, or is starting."""
        process = self.processes.get(robot)
        if process is None:
            return robot in self.setup.robots and robot not in self._never
        return process.agent is None and not process.is_over

    def _random_bytes(self, *purpose: Any) -> bytes:
        text = "/".join(map(str, (self.setup.seed, *purpose)))
        return hashlib.blake2b(text.encode(), digest_size=4).digest()

    def _launch_first(self, robot: str) -> None:
        self._to_launch -= 1
        if robot not in self._never:
            self.launch(robot, keeps_journal=True)

    def local_clock(self, robot: str) -> LocalClock:
        """The clock of this robot's computer."""
        return self._clocks.setdefault(robot, LocalClock(self.clock))

    def launch(self, robot: str, keeps_journal: bool) -> None:
        """Start a process of this robot, with what its journal kept or without."""
        self._lives += 1
        journal = self._journals.get(robot) if keeps_journal else None
        if journal is None:
            journal = self._journals[robot] = SimJournal()
            self.inspection.lost_journal(robot)
        setup, life = self.setup, self._lives
        description = setup.mission.robots[robot]
        identity = RobotIdentity(robot, description.type, 1_000 + life, setup.speed)
        config = AgentConfig(
            robot=robot,
            type=description.type,
            capabilities=dict(description.capabilities),
            run=self.run,
            nonce=self._random_bytes("nonce", robot, life).hex(),
            solver=setup.solvers.get(robot, setup.solver),
            timing=setup.timing,
            expected=frozenset(setup.robots),
            exit_when_done=setup.exit_when_done,
            software="simulator",
            restored=journal.read(),
            host="simulator",
            pid=identity.pid,
            engine=self._engine,
            plans_apart=setup.plan_delay_us is not None,
        )

        def make_agent(now_us: int) -> Agent:
            for other in self.processes.values():
                if other.token is not None and other is not process:
                    self._tell_token(other.robot, other.token, True, robot)
            return Agent(setup.mission, config, now_us)

        local = self.local_clock(robot)
        process = SimProcess(
            self, identity, setup.program, journal, local, make_agent, self.plan_delay_us
        )
        self.processes[robot] = process
        assert self._group is not None
        self._group.start_soon(process.main)
        self._failures.launched(process)

    # -- the network (process.Surroundings) ---------------------------------------------------

    def published(self, process: SimProcess, effect: Publish) -> None:
        now_us = self.clock.now_us
        event = MessageReceived(effect.kind, process.robot, effect.data)
        arrivals = self.network.arrivals_at_all(process.robot, self.processes, now_us)
        for arrival_us, targets in arrivals.items():
            self.clock.at(arrival_us, partial(self._arrive_at_all, targets, event))
        self._injector.heard(process.robot, event)
        self.observer.message(effect.kind, process.robot, effect.data, now_us)
        if effect.kind is MessageKind.FACT:
            self.inspection.published_facts()
        self._observe_soon()

    def _send(self, source: str, target: str, event: Input) -> None:
        for arrival_us in self.network.arrivals_us(source, target, self.clock.now_us):
            self.clock.at(arrival_us, partial(self.arrive, target, event))

    def _arrive_at_all(self, targets: list[str], event: Input) -> None:
        for target in targets:
            self.processes[target].deliver(event)

    def arrive(self, target: str, event: Input) -> None:
        """Hand an input to a robot's process."""
        process = self.processes.get(target)
        if process is not None:  # else it has not been started yet
            process.deliver(event)

    def asked(self, process: SimProcess, effect: Ask) -> None:
        number = len(self._questions) + 1
        question = self._questions[number] = _Question(process, effect.peer)
        if effect.peer in self.processes:
            query = QueryReceived(number, MessageKind.PULL, effect.data)
            self._send(process.robot, effect.peer, query)
        timeout_us = self.clock.now_us + self.setup.network.query_timeout_us
        self.clock.at(timeout_us, lambda: self._answer(question, None))

    def replied(self, process: SimProcess, effect: Reply) -> None:
        question = self._questions.get(effect.query)
        if question is None:
            return  # an operator's command, or garbage
        source, target = process.robot, question.asker.robot
        for page in effect.pages:
            # A query's replies are not duplicated: Zenoh tells them apart.
            for arrival_us in self.network.arrivals_us(source, target, self.clock.now_us)[:1]:
                self.clock.at(arrival_us, partial(self._answer, question, page))

    def _answer(self, question: _Question, page: bytes | None) -> None:
        if page is None and question.answered:
            return
        question.answered = True
        question.asker.deliver(AnswerReceived(question.peer, page))

    def declared(self, process: SimProcess, incarnation: Incarnation) -> None:
        if process.token is not None:
            self._tell_everybody(process.robot, process.token, False)
        process.token = incarnation
        self._tell_everybody(process.robot, incarnation, True)

    def _undeclare(self, process: SimProcess) -> None:
        if process.token is not None:
            self._tell_everybody(process.robot, process.token, False)
            process.token = None

    def _tell_everybody(self, robot: str, incarnation: Incarnation, held: bool) -> None:
        delay_us = self.setup.network.token_delay_us
        if delay_us is None and not held:
            return
        for target in self.processes:
            if target != robot and (robot, target) not in self.network.blocked:
                self._tell_token(robot, incarnation, held, target)
        at_us = self.clock.now_us + (delay_us or 0)
        self.clock.at(at_us, partial(self._observe_token, robot, incarnation, held))

    def _tell_token(self, robot: str, incarnation: Incarnation, held: bool, target: str) -> None:
        at_us = self.clock.now_us + (self.setup.network.token_delay_us or 0)
        event = TokenChanged(robot, incarnation, held)
        self.clock.at(at_us, partial(self.arrive, target, event))

    # -- what processes do --------------------------------------------------------------------

    def stopped(self, process: SimProcess) -> None:
        plan = process.agent.view.plan if process.agent else None
        if plan is not None and plan.result in (Status.SUCCESS, Status.FAILURE):
            # It has seen the whole team agree. Robots that it could not reach may never learn it.
            now_us = self.clock.now_us
            self.observer.record.over(plan.result, now_us)
            self.clock.at(now_us + GIVE_UP_DETECTIONS * self.timing.detection_us, self._give_up)
        self._undeclare(process)
        self.inspection.stopped()

    def outcome(self, process: SimProcess, event: ActionFinished) -> ActionFinished:
        return self._failures.outcome(process, event)

    def completed(self, process: SimProcess) -> None:
        robot = process.robot
        if robot in self._actions_left:
            self._actions_left[robot] -= 1
            if not self._actions_left[robot]:
                del self._actions_left[robot]
                self.clock.at(self.clock.now_us, partial(self.kill, robot))
        self._failures.completed(process)

    def recorded(self, process: SimProcess, event: Mapping[str, Any]) -> None:
        self.events.append(dict(event))

    # -- the observer -------------------------------------------------------------------------

    def _observe_token(self, robot: str, incarnation: Incarnation, held: bool) -> None:
        self.observer.token(robot, incarnation, held)
        self._observe_soon()

    def _observe_soon(self) -> None:
        if not self._observing:
            self._observing = True
            self.clock.at(self.clock.now_us, self._observe)

    def _observe(self) -> None:
        self._observing = False
        self.observer.update(self.clock.now_us)
        if self._nothing_left():
            self.over.set()

    def _observe_regularly(self) -> None:
        self._observe()
        self.inspection.sample()
        if self.inspection.is_settled or (self.setup.stop_when_stuck and self._is_stuck()):
            self.over.set()
        next_us = self.clock.now_us + self.setup.timing.heartbeat_us
        self.clock.at(next_us, self._observe_regularly)

    def _nothing_left(self) -> bool:
        if self._to_launch:
            return False  # they are still being launched
        if self.observer.record.result is not None:
            return not self.living()
        return not self._is_awaiting and all(p.is_over for p in self.processes.values())

    @property
    def _is_awaiting(self) -> bool:
        """Whether something is still to befall that could help the team."""
        return bool(self._pending or self._failures.awaited)

    def _is_stuck(self) -> bool:
        """Whether nothing more will happen: for as long as a verdict on a robot may take, nobody
        has worked or had anything to do, no deadline ran, and no fact has changed.
        """
        changes = self.observer.facts.changes
        if self._is_awaiting or self.setup.program.backgrounds or not self._rests():
            changes = -1
        if changes != self._stuck_since[0]:
            self._stuck_since = (changes, self.clock.now_us)
        return changes >= 0 and self._stuck_since[1] + self._patience_us <= self.clock.now_us

    @property
    def _patience_us(self) -> int:
        return self.timing.max_detection_us + self.timing.detection_us

    def _rests(self) -> bool:
        agents = [process.agent.view if process.agent else None for process in self.living()]
        return all(
            agent is not None
            and not agent.is_joining
            and agent.plan is not None
            and not agent.plan.lines
            and agent.action is None
            and not agent.waits_for_deadline
            for agent in agents
        )

    # -- faults -------------------------------------------------------------------------------

    def _befall_scheduled(self, fault: faults.Fault) -> None:
        self._pending -= 1
        self.befall(fault)

    def befall(self, fault: faults.Fault) -> None:
        """Let one fault happen now."""
        if self.setup.exit_when_done and self.observer.record.result is not None:
            return  # the mission is over, and with it the story
        self.inspection.befalls(fault)
        self.befallen[type(fault).__name__] += 1
        self._injector.inject(fault)
        if isinstance(fault, faults.Heal):
            self.healed_us = self.clock.now_us

    def kill(self, robot: str) -> None:
        """End this robot's process, or the first one before it has begun."""
        process = self.processes.get(robot)
        if process is None:
            self._never.add(robot)  # it dies before it has said a word
        elif not process.is_over:
            process.kill()
            self.observer.record.exited(robot, self.clock.now_us)
            self._undeclare(process)

    def kill_after(self, robot: str, actions: int) -> None:
        """End this robot's process once so many more of its actions have ended by themselves."""
        self._actions_left[robot] = actions

    def _time_out(self) -> None:
        self.timed_out = True
        self.over.set()

    def _give_up(self) -> None:
        self.gave_up = True
        self.over.set()

    def _failed(self, error: Exception) -> None:
        self.error = error
        self.over.set()
