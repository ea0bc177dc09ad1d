"""The simulator driven by hand, without programs and checkers: for what concerns membership alone.

A `World` whose robots' actions never end by themselves, so that it needs no event loop: the
driver lets time pass, and between two moments ends actions, freezes robots, cuts links.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from contextvars import copy_context
from dataclasses import replace
from functools import partial

from mrbt_mesh.core.agent.effects import (
    Ask,
    CancelAction,
    Effect,
    Publish,
    Reply,
    StartAction,
)
from mrbt_mesh.core.agent.inputs import (
    ActionFinished,
    ActionStopped,
    Input,
    InputBatch,
    MessageReceived,
)
from mrbt_mesh.core.agent.view import AgentView
from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.core.membership.timing import Timing
from mrbt_mesh.core.membership.wire import MessageKind
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.runtime.actions import ActionRunner, ProgramEffect
from mrbt_mesh.runtime.program import RobotProgram
from mrbt_mesh.runtime.step_gate import StepGate
from mrbt_mesh.sim.world.network import Network, NetworkKnobs
from mrbt_mesh.sim.world.process import Inspection, SimProcess
from mrbt_mesh.sim.world.setup import AgentOptions, Setup
from mrbt_mesh.sim.world.sharing import HandedOver, shared_engine
from mrbt_mesh.sim.world.world import World

START_SPREAD_US = 200_000
NEVER_US = 1 << 60


class SteppedTeam:
    """Robots of one mission, driven by `run_until`; the same seed gives the same run.

    `on_beat(source, target, now_us)` sees every beat before it is taken in, `on_step(agent,
    now_us)` every agent after it has taken in something. `sent` and `sent_bytes` count copies: a
    beat to five peers counts five times. `received` counts what came to each robot.

    With `round_us` robots come round only that often, and take in what has come together, as busy
    processes do. `is_shared`: robots hand beats over as they are and make each plan once; for
    large teams.
    """

    def __init__(
        self,
        mission: Mission,
        network: NetworkKnobs,
        seed: int,
        timing: Timing | None = None,
        round_us: int = 0,
        is_shared: bool = False,
    ) -> None:
        self.mission = mission
        self.sent = 0
        self.sent_bytes = 0
        self.received: Counter[str] = Counter()
        self.on_beat: Callable[[str, str, int], None] | None = None
        self.on_step: Callable[[AgentView, int], None] | None = None
        self._round_us = round_us
        options = AgentOptions(timing=timing or Timing(), exit_when_done=False)
        self._plain_engine = options.engine
        setup = Setup(
            mission=mission,
            program=RobotProgram(),
            seed=seed,
            robots=tuple(sorted(mission.robots)),
            timeout_us=NEVER_US,
            network=network,
            agents=options,
            start_spread_us=START_SPREAD_US,
        )
        if is_shared:
            engine = shared_engine(setup.header, options.engine)
            setup = replace(setup, agents=replace(options, engine=engine))
        self._world = _UnobservedWorld(setup, lambda world: _Watch(self))
        self._programs: dict[str, _HeldActions] = {}

    @property
    def now_us(self) -> int:
        return self._world.clock.now_us

    @property
    def network(self) -> Network:
        return self._world.network

    # -- what a driver may do -----------------------------------------------------------------

    def launch_all(self) -> None:
        """Start all robots, within a beat period."""
        self._world.robots.launch_all(self._start)

    def launch(self, robot: str) -> None:
        """Start one robot again, with an empty journal."""
        self._world.robots.launch(robot, keeps_journal=False)

    def kill(self, robot: str) -> None:
        """SIGKILL: the system takes its token down."""
        self._world.robots.kill(robot)

    def freeze(self, robot: str) -> None:
        """SIGSTOP."""
        self._world.robots.processes[robot].pace.freeze()

    def thaw(self, robot: str) -> None:
        """SIGCONT."""
        self._world.robots.processes[robot].pace.thaw()

    def runs(self, robot: str) -> bool:
        """Whether it lives and is not frozen."""
        return self._world.robots.processes[robot].runs

    def agent(self, robot: str) -> AgentView:
        """The agent of its latest process."""
        agent = self._world.robots.processes[robot].agent
        assert agent is not None
        return agent.view

    def living(self) -> list[AgentView]:
        """Of those that run and are not frozen, sorted by robot."""
        return [self.agent(process.robot) for process in self._world.living()]

    def at_work(self) -> list[str]:
        """Robots that carry out an action, sorted."""
        return [
            agent.robot for agent in self.living() if self._programs[agent.robot].action is not None
        ]

    def end_action(self, robot: str, conditions: tuple[tuple[str, bool], ...] = ()) -> None:
        """Its action ends with success, and with these conditions."""
        program = self._programs[robot]
        assert program.action is not None
        ticket, program.action = program.action, None
        self.give(robot, ActionFinished(ticket, True, conditions))

    def give(self, robot: str, event: Input) -> None:
        """One input to one robot, and what follows from it."""
        self._world.robots.processes[robot].deliver(event)

    def wrap_handle(self, robot: str, wrapper: Callable[..., list[Effect]]) -> None:
        """From now on its agent takes inputs by `wrapper(handle, event, now_us)`."""
        agent = self._world.robots.processes[robot].agent
        assert agent is not None
        vars(agent)["handle"] = partial(wrapper, agent.handle)

    def run_until(self, until_us: int) -> None:
        """Let everything happen up to that time."""
        self._world.clock.advance((until_us - self.now_us) / 1e6)

    # -- inside -------------------------------------------------------------------------------

    def _start(self, process: SimProcess) -> None:
        program = self._programs[process.robot] = _HeldActions(process)
        process.boot(program, copy_context(), program.end)
        if self._round_us:
            # All of them in step, so that they mostly know the same.
            clock = self._world.clock
            at_us = -(-clock.now_us // self._round_us) * self._round_us
            clock.at(at_us, partial(process.pace.slow, self._round_us))

    def count(self, process: SimProcess, effect: Effect) -> None:
        """What an agent has sent."""
        match effect:
            case Publish(_, data, to):
                copies = len(self._world.robots.processes) - 1 if to is None else len(to)
                self.sent += copies
                if isinstance(data, HandedOver) and process.agent is not None:
                    header = process.agent.view.header
                    data = self._plain_engine.write_heartbeat(data.beat, header)
                self.sent_bytes += copies * len(data)
            case Ask(_, data):
                self.sent += 1
                self.sent_bytes += len(data)
            case Reply(_, pages):
                self.sent += len(pages)
                self.sent_bytes += sum(map(len, pages))


class _HeldActions(ActionRunner):
    """Actions that go on until they are cancelled, without a program. `action`: the ticket."""

    def __init__(self, process: SimProcess) -> None:
        self.action: int | None = None
        self.backgrounds = 0
        self.gate = StepGate(lambda: None, lambda: True)
        self._process = process

    def start_background(self) -> None:
        pass

    def carry_out(self, effect: ProgramEffect) -> None:
        match effect:
            case StartAction(ticket):
                self.action = ticket
            case CancelAction(ticket):
                self.action = None
                self._process.submit(ActionStopped(ticket))

    def end(self) -> None:
        self.action = None


class _UnobservedWorld(World):
    """Without the observer, which in a large team has as much to do as the robots."""

    def published(self, process: SimProcess, effect: Publish) -> None:
        self.bus.publish(process.robot, effect)

    def _token_changed(self, robot: str, incarnation: Incarnation, held: bool) -> None:
        pass


class _Watch(Inspection):
    """Counts messages, and reports steps and heartbeats to the driver."""

    def __init__(self, team: SteppedTeam) -> None:
        super().__init__()
        self._team = team

    def handling(self, process: SimProcess, event: Input) -> None:
        team = self._team
        for each in event.inputs if isinstance(event, InputBatch) else (event,):
            if isinstance(each, MessageReceived):
                team.received[process.robot] += 1
                if each.kind is MessageKind.HEARTBEAT and team.on_beat is not None:
                    team.on_beat(each.source, process.robot, team.now_us)

    def handled(self, process: SimProcess, event: Input, effects: Sequence[Effect]) -> None:
        for effect in effects:
            self._team.count(process, effect)
        if self._team.on_step is not None and process.agent is not None:
            self._team.on_step(process.agent.view, self._team.now_us)
