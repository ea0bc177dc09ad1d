"""A team of agents in memory: messages arrive at once, time passes when the script says so.

`Team` runs agents and writes down what they do; `Script` lets a text file talk to one, in the
manner of etcd/raft's golden files: a block is a few commands, a line `----` and what followed.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from mrbt_mesh.core.agent import effects as fx
from mrbt_mesh.core.agent import inputs
from mrbt_mesh.core.agent.agent import Agent
from mrbt_mesh.core.agent.commands import command_body
from mrbt_mesh.core.agent.config import AgentConfig
from mrbt_mesh.core.assignment.solvers import min_cost_flow
from mrbt_mesh.core.bt.activation import parse_activation
from mrbt_mesh.core.bt.tree import NodeSpec
from mrbt_mesh.core.facts.records import CoalitionId, Phase
from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.core.membership.timing import Timing
from mrbt_mesh.core.membership.wire import Header, MessageKind, decode, encode
from mrbt_mesh.core.mission.mission import GlobalTask, InDoubtPolicy, Mission
from mrbt_mesh.core.observer.observer import Observer
from tests.support import build

MS = 1_000
TIMING = Timing(heartbeat_us=100 * MS, detection_us=1_000 * MS)
AT_MOST = 50_000


@dataclass
class Process:
    """One robot's process. A frozen one keeps its mail for later."""

    name: str
    agent: Agent
    frozen: bool = False
    mail: deque[inputs.Input] = field(default_factory=deque)
    token: Incarnation | None = None
    tickets: list[int] = field(default_factory=list)
    asked: list[fx.RequestBid] = field(default_factory=list)
    stops_at_once: bool = True

    @property
    def robot(self) -> str:
        return self.agent.view.robot


class Team:
    """Agents, the links between them, and the story of what they did."""

    def __init__(self) -> None:
        self.now_us = 0
        self.processes: dict[str, Process] = {}
        self.cuts: set[frozenset[str]] = set()
        self.story: list[str] = []
        self.observer: Observer | None = None
        self._queries: dict[tuple[str, int], Process] = {}
        self._waiting: deque[Process] = deque()
        self._query = 0

    # -- what a test may do -------------------------------------------------------------------

    def start(self, name: str, mission: Mission, config: AgentConfig) -> Process:
        """Start a process; `name` differs from the robot's id only for a second one."""
        agent = Agent(mission, config, self.now_us)
        process = self.processes[name] = Process(name, agent)
        for other in self._others(process):
            if other.token is not None:
                self._post(process, inputs.TokenChanged(other.robot, other.token, True))
        self.give(process, inputs.TimerFired())
        return process

    def give(self, process: Process, event: inputs.Input) -> None:
        """One input, and everything that follows from it at this instant."""
        self._post(process, event)
        self._drain()

    def pass_time(self, ms: int) -> None:
        """Fire timers until that many milliseconds have passed."""
        until_us = self.now_us + ms * MS
        while True:
            awake = [p for p in self.processes.values() if not p.frozen]
            due = {p.name: p.agent.next_deadline_us(self.now_us) for p in awake}
            next_us = min(due.values(), default=until_us + 1)
            if next_us > until_us:
                break
            self.now_us = next_us
            for process in awake:
                if due[process.name] == next_us and process.name in self.processes:
                    self.give(process, inputs.TimerFired())
        self.now_us = until_us

    def kill(self, name: str) -> None:
        """The process is gone; the system takes its token down at once."""
        process = self.processes.pop(name)
        self._token_gone(process)
        self._drain()

    def freeze(self, name: str) -> None:
        self.processes[name].frozen = True

    def thaw(self, name: str) -> None:
        """The process goes on, with a full mailbox."""
        process = self.processes[name]
        process.frozen = False
        self._waiting.append(process)
        self._drain()

    def command(self, name: str, command: str, argument: str = "") -> None:
        """The operator asks one robot for something."""
        process = self.processes[name]
        header = process.agent.view.header
        mine = Header(header.mission, header.mission_name, header.run, "")
        body = encode(mine, MessageKind.COMMAND, command_body(command, argument))
        self.give(process, inputs.QueryReceived(0, MessageKind.COMMAND, body))

    def cut(self, one: str, other: str) -> None:
        self.cuts.add(frozenset((one, other)))

    def mend(self, one: str, other: str) -> None:
        self.cuts.discard(frozenset((one, other)))

    # -- delivering ---------------------------------------------------------------------------

    def _others(self, process: Process) -> list[Process]:
        """Processes that this one reaches."""
        return [
            other
            for other in self.processes.values()
            if other is not process and frozenset((process.name, other.name)) not in self.cuts
        ]

    def _post(self, process: Process, event: inputs.Input) -> None:
        process.mail.append(event)
        if not process.frozen:
            self._waiting.append(process)

    def _drain(self) -> None:
        for _ in range(AT_MOST):
            if not self._waiting:
                if self.observer is not None:
                    self.observer.update(self.now_us)
                return
            process = self._waiting.popleft()
            while process.mail and not process.frozen and process.name in self.processes:
                for effect in process.agent.handle(process.mail.popleft(), self.now_us):
                    self._carry_out(process, effect)
        raise AssertionError(f"never at rest after {AT_MOST} inputs at {self.now_us} us")

    def _carry_out(self, process: Process, effect: fx.Effect) -> None:
        match effect:
            case fx.Publish() | fx.Ask() | fx.Reply() | fx.DeclareToken():
                self._send(process, effect)
            case fx.StartAction():
                process.tickets.append(effect.ticket)
                partners = f" with {', '.join(effect.partners)}" if effect.partners else ""
                self._tell(process, f"starts {effect.local_task}{partners}")
            case fx.CancelAction(ticket):
                self._tell(process, "cancels its action")
                if process.stops_at_once:
                    process.tickets.remove(ticket)
                    self._post(process, inputs.ActionStopped(ticket))
            case fx.RequestBid(_, _, local_task):
                process.asked.append(effect)
                self._tell(process, f"is asked to bid for {local_task}")
            case fx.Stop(code, reason):
                self._tell(process, f"stops with {code}: {reason}")
                self.processes.pop(process.name, None)
                self._token_gone(process)
            case fx.Log(level, event, fields):
                if event not in ("local_task_started", "local_task_finished", "robot_heard"):
                    texts = [f"{key}={value}" for key, value in fields.items()]
                    self._tell(process, " ".join([f"({level}) {event}", *texts]))

    def _send(
        self, process: Process, effect: fx.Publish | fx.Ask | fx.Reply | fx.DeclareToken
    ) -> None:
        match effect:
            case fx.Publish(kind, data):
                if kind is MessageKind.FACT:
                    self._tell(process, f"writes {batch_text(process, data)}")
                for other in self._others(process):
                    self._post(other, inputs.MessageReceived(kind, process.robot, data))
                if self.observer is not None:
                    self.observer.message(kind, process.robot, data, self.now_us)
            case fx.Ask(peer, data):
                for other in self._others(process):
                    if other.robot == peer:
                        self._query += 1
                        self._queries[other.name, self._query] = process
                        event = inputs.QueryReceived(self._query, MessageKind.PULL, data)
                        self._post(other, event)
            case fx.Reply(query, pages):
                self._reply(process, query, pages)
            case fx.DeclareToken(incarnation):
                self._token_gone(process)
                process.token = incarnation
                for other in self._others(process):
                    self._post(other, inputs.TokenChanged(process.robot, incarnation, True))

    def _reply(self, process: Process, query: int, pages: tuple[bytes, ...]) -> None:
        asker = self._queries.pop((process.name, query), None)
        if asker is not None:
            for page in pages:
                self._post(asker, inputs.AnswerReceived(process.robot, page))
        else:
            header = process.agent.view.header
            _, (good, text) = decode(pages[0], header, MessageKind.ANSWER)
            self._tell(process, f"answers {'yes' if good else 'no'}: {text}")

    def _token_gone(self, process: Process) -> None:
        if process.token is not None:
            for other in self._others(process):
                self._post(other, inputs.TokenChanged(process.robot, process.token, False))
            if self.observer is not None:
                self.observer.token(process.robot, process.token, False)
            process.token = None

    def _tell(self, process: Process, text: str) -> None:
        self.story.append(f"{self.now_us // MS:>5} {process.name} {text}")


def batch_text(process: Process, data: bytes) -> str:
    """The entries of one published batch, in short."""
    _, groups = decode(data, process.agent.view.header, MessageKind.FACT)
    assert len(groups) == 1, "a batch is written in one step"
    return ", ".join(entry_text(name, value) for name, value in groups[0][4])


def entry_text(name: str, value: object) -> str:
    kind, *parts = name.split("/")
    match kind, value:
        case "outcome", [success, data]:
            how = "success" if success else "failure"
            more = "" if data is None else f" {data}"
            return f"{how} of {parts[1]} for {parse_activation(parts[0]).subject}{more}"
        case "condition", [holds, revision, _]:
            return f"{parts[0]}={str(holds).lower()} (revision {revision})"
        case "claim", [_, task, local, phase, _, _]:
            return f"claim {Phase(phase).name.lower()} {local} for {task}"
        case "coalition", members:
            return f"coalition of {', '.join(row[0] for row in members)}"
        case (("broken" | "grant" | "doubt" | "cleared"), True):
            leader = CoalitionId.parse(parts[1]).leader
            return f"{kind} of {leader} for {parse_activation(parts[0]).subject}"
        case "bid", bid:
            return f"bid {'none' if bid is None else f'{bid / 1e6:g}'} for {parts[1]}"
        case "claim", None:
            return "no claim"
        case "member", [_, _, lost, leaving, *_]:
            text = f" lost={','.join(lost)}" if lost else ""
            return f"member{text}{' leaving' if leaving else ''}"
        case "order", [order, _]:
            return f"order {order}"
        case "attempt", number:
            return f"attempt {number}"
    scope = parse_activation(parts[0])
    return f"{kind} {scope.subject or f'node {scope.node}'}"


# -- scripts ----------------------------------------------------------------------------------


def leaf(text: NodeSpec | str) -> NodeSpec:
    """`"fix"` is an action, `"?open"` a condition."""
    if isinstance(text, NodeSpec):
        return text
    return build.condition(text[1:]) if text.startswith("?") else build.action(text)


WORDS: dict[str, Callable[..., NodeSpec]] = {
    "Sequence": lambda *children: build.sequence(*map(leaf, children)),
    "Fallback": lambda *children: build.fallback(*map(leaf, children)),
    "Parallel": lambda needed, *children: build.parallel(needed, *map(leaf, children)),
    "Retry": lambda limit, child: build.retry(limit, leaf(child)),
    "Timeout": lambda seconds, child: build.timeout(seconds, leaf(child)),
}


class Script:
    """Carries out the commands of a golden file."""

    def __init__(self) -> None:
        self.team = Team()
        self.robots: dict[str, dict[str, float]] = {}
        self.tasks: list[GlobalTask] = []
        self.tree: NodeSpec | None = None
        self._lives = 0

    def block(self, commands: list[str]) -> str:
        """What followed from some commands."""
        self.team.story.clear()
        for line in commands:
            text, _, _ = line.partition("#")
            if text.strip():
                word, *arguments = text.split()
                getattr(self, f"do_{word}")(*arguments)
        return "\n".join(self.team.story) or "ok"

    def do_robot(self, name: str, *capabilities: str) -> None:
        """robot A lift weld*0.5"""
        pairs = (each.partition("*") for each in capabilities)
        self.robots[name] = {local: float(value or 1) for local, _, value in pairs}

    def do_task(self, name: str, *words: str) -> None:
        """task cover lift 2..2 fail_after=0.5; task dose pour exclusive in_doubt=retry;
        task fetch drive 1..1 bid_within=0.5"""
        needs: list[tuple[Any, ...]] = []
        policies: dict[str, Any] = {}
        for word in words:
            key, is_policy, value = word.partition("=")
            if word == "bid" or key == "bid_within":
                within_us = round(float(value) * 1e6) if is_policy else None
                needs[-1] = (*needs[-1], True, within_us)
            elif word in ("simultaneous", "exclusive"):
                policies[word] = True
            elif key == "in_doubt":
                policies[key] = InDoubtPolicy(value)
            elif is_policy:
                policies["blocked_fail_after_us"] = round(float(value) * 1e6)
            elif ".." in word:
                low, _, high = word.partition("..")
                needs[-1] = (needs[-1][0], int(low), int(high))
            else:
                needs.append((key, 1, 1))
        self.tasks.append(build.task(name, *needs, **policies))

    def do_tree(self, *words: str) -> None:
        self.tree = leaf(eval(" ".join(words), dict(WORDS)))

    def mission(self, name: str = "m") -> Mission:
        assert self.tree is not None
        return build.make_mission(self.tree, self.robots, self.tasks, name=name)

    def do_start(self, *names: str) -> None:
        """start A B; start A2=A takeover: a second process under the id A"""
        options = {"takeover", "exit_when_done", "alone"}
        mission = self.mission()
        for name in names:
            if name not in options:
                self.launch(name, mission, options & set(names))

    def do_observe(self) -> None:
        """From now on an observer listens."""
        mission = self.mission()
        self.team.observer = Observer(mission, build.RUN, TIMING, min_cost_flow)

    def do_stranger(self, name: str) -> None:
        """A robot that runs another mission file."""
        self.launch(name, self.mission("another"), set())

    def launch(self, name: str, mission: Mission, options: set[str]) -> None:
        process, _, robot = name.partition("=")
        robot = robot or process
        self._lives += 1
        config = AgentConfig(
            robot,
            "T",
            build.micro(self.robots[robot]),
            build.RUN,
            f"n{self._lives}",
            min_cost_flow,
            TIMING,
            expected=frozenset(() if "alone" in options else self.robots),
            takeover="takeover" in options,
            exit_when_done="exit_when_done" in options,
        )
        self.team.start(process, mission, config)

    def do_pass(self, ms: str) -> None:
        self.team.pass_time(int(ms))

    def end_action(self, name: str, success: bool, words: tuple[str, ...], error: str = "") -> None:
        process = self.team.processes[name]
        conditions = tuple((k, v == "true") for k, _, v in (w.partition("=") for w in words))
        ticket = process.tickets.pop()
        event = inputs.ActionFinished(ticket, success, None, conditions, error)
        self.team.give(process, event)

    def do_succeed(self, name: str, *conditions: str) -> None:
        """succeed A open=true"""
        self.end_action(name, True, conditions)

    def do_fail(self, name: str, *conditions: str) -> None:
        self.end_action(name, False, conditions)

    def do_raise(self, name: str) -> None:
        """The action's code raises: the runtime reports a failure with the traceback."""
        self.end_action(name, False, (), "Traceback: ZeroDivisionError")

    def do_bid(self, name: str, *words: str) -> None:
        """bid A fetch=-3 carry=none: what its program says to what it was asked, all at once."""
        process = self.team.processes[name]
        values = dict(word.split("=") for word in words)
        bids = []
        for asked in [a for a in process.asked if a.local_task in values]:
            text = values[asked.local_task]
            value = None if text in ("none", "raises") else round(float(text) * 1e6)
            error = "Traceback: ZeroDivisionError" if text == "raises" else ""
            bids.append(inputs.BidMade(asked.activation, asked.local_task, value, error))
            process.asked.remove(asked)
        self.team.give(process, inputs.BidsMade(tuple(bids)))

    def do_set(self, name: str, condition: str) -> None:
        key, _, value = condition.partition("=")
        self.team.give(self.team.processes[name], inputs.ConditionSet(key, value == "true"))

    def do_stop_slowly(self, name: str) -> None:
        """From now on a cancelled action takes its time."""
        self.team.processes[name].stops_at_once = False

    def do_stopped(self, name: str) -> None:
        process = self.team.processes[name]
        self.team.give(process, inputs.ActionStopped(process.tickets.pop(0)))

    def do_tell(self, name: str, command: str, *words: str) -> None:
        """tell A fault lift; tell A order pause; tell A decide dose retry"""
        self.team.command(name, command, " ".join(words))

    def do_leave(self, name: str) -> None:
        self.team.give(self.team.processes[name], inputs.LeaveRequested())

    def do_kill(self, name: str) -> None:
        self.team.kill(name)

    def do_freeze(self, name: str) -> None:
        self.team.freeze(name)

    def do_thaw(self, name: str) -> None:
        self.team.thaw(name)

    def do_cut(self, one: str, other: str) -> None:
        self.team.cut(one, other)

    def do_mend(self, one: str, other: str) -> None:
        self.team.mend(one, other)

    def do_show(self) -> None:
        """What every robot thinks: its mission's status, who is alive, who does what."""
        for process in self.team.processes.values():
            agent = process.agent
            if agent.view.plan is None:
                self.team.story.append(f"{process.name}: joining")
                continue
            alive = ",".join(robot for robot in agent.view.alive() if robot != agent.view.robot)
            lines = " ".join(f"{r}:{x.local_task}" for r, x in agent.view.plan.lines.items())
            waiting = "".join(f"; {w.global_task} {w.reason}" for w in agent.view.plan.waiting)
            status = agent.view.plan.result.name.lower()
            hears = f"hears {alive or 'nobody'}"
            self.team.story.append(
                f"{process.name}: {status}; {hears}; {lines or 'no work'}{waiting}"
            )
