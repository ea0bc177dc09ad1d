"""A team of agents in memory: messages arrive at once, time passes when the script says so.

`Team` runs agents and writes down what they do; tests/support/script.py lets texts talk to one.
"""

from __future__ import annotations

import contextlib
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import msgpack

from mrbt_mesh.core.agent import effects as fx
from mrbt_mesh.core.agent import inputs
from mrbt_mesh.core.agent.agent import Agent
from mrbt_mesh.core.agent.config import AgentConfig
from mrbt_mesh.core.agent.operator_messages import (
    OPERATE,
    CommandStep,
    command_body,
    command_version,
    operate_body,
)
from mrbt_mesh.core.bt.activation import parse_activation
from mrbt_mesh.core.facts.records import COMMANDS, Phase
from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.core.membership.envelope import ForgedError, parse_envelope
from mrbt_mesh.core.membership.keys import Keys, make_command
from mrbt_mesh.core.membership.timing import Timing
from mrbt_mesh.core.membership.wire import Header, MessageKind, decode, encode
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.observer.observer import Observer

# (message, receiver) -> the message in an envelope.
Seal = Callable[[bytes, str], bytes]
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
    router: str = ""
    tickets: list[int] = field(default_factory=list)
    asked: list[Any] = field(default_factory=list)
    searches: list[fx.SearchSchedule] = field(default_factory=list)
    stops_at_once: bool = True
    is_sealed: bool = False
    # While its disk syncs nothing: the number of what it is to sync last.
    is_disk_slow: bool = False
    is_disk_full: bool = False
    unsynced: int = 0

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
        self.observers: list[Observer] = []
        self.dead_routers: set[str] = set()
        # All that was published, as a stranger on the network has it.
        self.heard: list[inputs.MessageReceived] = []
        self._queries: dict[tuple[str, int], Process] = {}
        self._waiting: deque[Process] = deque()
        self._query = self._commands = 0

    # -- what a test may do -------------------------------------------------------------------

    def start(self, name: str, mission: Mission, config: AgentConfig) -> Process:
        """Start a process; `name` differs from the robot's id only for a second one."""
        agent = Agent(mission, config, self.now_us)
        process = self.processes[name] = Process(name, agent, is_sealed=config.keys is not None)
        for other in self._others(process):
            if other.token is not None:
                self._post(process, _token(other, True))
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
            # Where no robot does anything observers look all the same.
            next_us = min(due.values(), default=self.now_us + TIMING.heartbeat_us)
            if next_us > until_us:
                break
            self.now_us = next_us
            if not awake:
                self._drain()
            for process in awake:
                if due[process.name] == next_us and process.name in self.processes:
                    self.give(process, inputs.TimerFired())
        self.now_us = until_us

    def kill(self, name: str) -> None:
        """The process ends; the system takes its token down at once."""
        process = self.processes.pop(name)
        self._token_gone(process)
        self._drain()

    @property
    def observer(self) -> Observer | None:
        """The one that came last."""
        return self.observers[-1] if self.observers else None

    def freeze(self, name: str) -> None:
        self.processes[name].frozen = True

    def thaw(self, name: str) -> None:
        """The process goes on, with a full mailbox, as the driver would."""
        process = self.processes[name]
        process.frozen = False
        process.mail = deque(inputs.together(process.mail))
        self._waiting.append(process)
        self._drain()

    def command(
        self, name: str, command: str, argument: Any = "", seal: Seal | None = None
    ) -> bytes:
        """The operator asks one robot for something; returns the message."""
        process = self.processes[name]
        header = process.agent.view.header
        mine = Header(header.mission, header.mission_name, header.run, "")
        body = encode(mine, MessageKind.COMMAND, command_body(command, argument))
        message = seal(body, process.robot) if seal is not None else body
        self.give(process, inputs.QueryReceived(0, MessageKind.COMMAND, message))
        return message

    def operate(
        self, name: str, field: str, value: Any, seal: Seal | None = None, keys: Keys | None = None
    ) -> bytes:
        """An operator, who has seen what a robot has, commands a field of a subject at it; returns
        the message.
        """
        self._commands += 1
        view = self.processes[name].agent.view
        version = command_version(view.facts.max_stamp + 1, f"c{self._commands}")
        entry = make_command(field, value, "op", version, view.header.run, keys)
        return self.command(name, OPERATE, operate_body(CommandStep.WRITE, entry), seal)

    def sync(self, process: Process) -> None:
        """What the process has handed to its disk is there, unless the disk is slow."""
        if process.unsynced and not process.is_disk_slow:
            self._post(process, inputs.JournalSynced(process.unsynced))
            process.unsynced = 0

    def kill_router(self, name: str) -> None:
        """Its clients lose their link to all, and everybody else loses their tokens."""
        self.dead_routers.add(name)
        for process in self.processes.values():
            for other in self._others(process):
                if name in (process.router, other.router) and other.token is not None:
                    self._post(process, _token(other, False))
        self._drain()

    def change_router(self, name: str, router: str) -> None:
        """A client is linked to another router by now; it and all others are there again."""
        process = self.processes[name]
        process.router = router
        for other in self._others(process):
            if other.token is not None and process.token is not None:
                self._post(process, _token(other, True))
                self._post(other, _token(process, True))
        self._drain()

    def cut(self, one: str, other: str) -> None:
        self.cuts.add(frozenset((one, other)))

    def mend(self, one: str, other: str) -> None:
        self.cuts.discard(frozenset((one, other)))

    # -- delivering ---------------------------------------------------------------------------

    def _others(self, process: Process) -> list[Process]:
        """Processes between which and this one nothing is cut."""
        return [
            other
            for other in self.processes.values()
            if other is not process and frozenset((process.name, other.name)) not in self.cuts
        ]

    def _reached(self, process: Process) -> list[Process]:
        """Those that hear what this one says."""
        dead = self.dead_routers
        if process.router in dead:
            return []
        return [other for other in self._others(process) if other.router not in dead]

    def _post(self, process: Process, event: inputs.Input) -> None:
        process.mail.append(event)
        if not process.frozen:
            self._waiting.append(process)

    def _drain(self) -> None:
        for _ in range(AT_MOST):
            if not self._waiting:
                for observer in self.observers:
                    observer.update(self.now_us)
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
            case fx.AskRouter(robot, incarnation, router):
                linked = [p for p in self.processes.values() if p.router == router]
                is_linked = any(other.robot == robot for other in linked)
                answer = None if router in self.dead_routers else is_linked
                self._post(process, inputs.RouterAnswered(robot, incarnation, answer))
            case fx.Persist(_, _, number) if number:
                process.unsynced = number
                self.sync(process)
            case fx.StartAction():
                process.tickets.append(effect.ticket)
                self._tell(process, start_text(effect))
            case fx.CancelAction(ticket):
                self._tell(process, "cancels its action")
                if process.stops_at_once:
                    process.tickets.remove(ticket)
                    self._post(process, inputs.ActionStopped(ticket))
            case fx.FeatureEffect():
                process.asked.append(effect)
                self._tell(process, asked_text(effect))
            case fx.SearchSchedule():
                process.searches.append(effect)
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
            case fx.Publish(kind, data, to):
                self.heard.append(inputs.MessageReceived(kind, process.robot, data))
                if kind is MessageKind.FACT:
                    self._tell(process, f"writes {batch_text(process, data)}")
                for other in self._reached(process):
                    if to is not None and other.robot not in to:
                        continue
                    self._post(other, inputs.MessageReceived(kind, process.robot, data))
                for observer in self.observers:
                    observer.message(kind, process.robot, data, self.now_us)
            case fx.Ask(peer, data):
                for other in self._reached(process):
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
                    self._post(other, _token(process, True))

    def _reply(self, process: Process, query: int, pages: tuple[bytes, ...]) -> None:
        asker = self._queries.pop((process.name, query), None)
        if asker is not None:
            for page in pages:
                self._post(asker, inputs.AnswerReceived(process.robot, page))
        elif not pages:
            self._tell(process, "answers nothing")
        else:
            header, answer = process.agent.view.header, pages[0]
            with contextlib.suppress(ForgedError):
                answer = parse_envelope(answer).data
            kind, what, *_ = msgpack.unpackb(answer)
            if kind == "refused":
                self._tell(process, f"refuses this: {what}")
                return
            if what == MessageKind.STATE:
                self._tell(process, "answers with its facts")
                return
            _, (good, found) = decode(answer, header, MessageKind.ANSWER)
            text = found if isinstance(found, str) else _answer_text(found)
            self._tell(process, f"answers {'yes' if good else 'no'}: {text}")

    def _token_gone(self, process: Process) -> None:
        if process.token is not None:
            for other in self._others(process):
                self._post(other, _token(process, False))
            for observer in self.observers:
                observer.membership.receive_token(process.robot, process.token, False)
            process.token = None

    def _tell(self, process: Process, text: str) -> None:
        self.story.append(f"{self.now_us // MS:>5} {process.name} {text}")


def start_text(effect: fx.StartAction) -> str:
    partners = f" with {', '.join(effect.partners)}" if effect.partners else ""
    way = f"sets out for {effect.travel_to} to" if effect.travel_to else "starts"
    return f"{way} {effect.local_task}{partners}"


def asked_text(effect: fx.FeatureEffect) -> str:
    # Loaded here: the kernel's own tests run without features.
    from mrbt_mesh.features.bids.messages import RequestBid

    assert isinstance(effect, RequestBid)
    return f"is asked to bid for {effect.local_task}"


def _token(process: Process, held: bool) -> inputs.TokenChanged:
    assert process.token is not None
    return inputs.TokenChanged(process.robot, process.token, held, process.router)


def batch_text(process: Process, data: bytes) -> str:
    """The entries of one published batch, in short."""
    if process.is_sealed:
        data = parse_envelope(data).data
    _, groups = decode(data, process.agent.view.header, MessageKind.FACT)
    assert len(groups) == 1, "a batch is written in one step"
    return ", ".join(entry_text(name, value) for name, value in groups[0][4])


def entry_text(name: str, value: object) -> str:
    kind, *parts = name.split("/")
    match kind, value:
        case "outcome", [success, data, *reason]:
            how = f"failure ({reason[0]})" if reason else "success" if success else "failure"
            more = "" if data is None else f" {data}"
            return f"{how} of {parts[1]} for {parse_activation(parts[0]).subject}{more}"
        case "condition", [holds, revision, _]:
            return f"{parts[0]}={str(holds).lower()} (revision {revision})"
        case "claim", [_, task, local, phase, _, _, *place]:
            where = f" at {place[0]}" if place else ""
            return f"claim {Phase(phase).name.lower()} {local} for {task}{where}"
        case "coalition", members:
            return f"coalition of {', '.join(row[0] for row in members)}"
        case (("broken" | "grant" | "doubt" | "cleared"), True):
            leader = parts[1].partition(".")[0]
            return f"{kind} of {leader} for {parse_activation(parts[0]).subject}"
        case "bid", bid:
            return f"bid {'none' if bid is None else f'{bid / 1e6:g}'} for {parts[1]}"
        case "claim", place:
            return "no claim" + (f" at {place}" if place else "")
        case "member", [_, _, reasons, leaving, *_]:
            lost = [f"{','.join(names)} ({reason})" for reason, names in reasons.items()]
            text = f" lost={'; '.join(lost)}" if lost else ""
            return f"member{text}{' leaving' if leaving else ''}"
    return latch_text(kind, parts, value)


def latch_text(kind: str, parts: list[str], value: object) -> str:
    match kind, value:
        case _, [command, str(operator), str(), str()] if kind in COMMANDS:
            return f"{' '.join([kind, *parts])} {command} of {operator}"
        case "result", [success, _]:
            return f"the mission's {'success' if success else 'failure'}"
        case "expression", [revision, _]:
            return f"{parts[0]} (revision {revision})"
        case "problem", text:
            return f"problem of {parts[0]}: {text}"
        case "attempt", number:
            return f"attempt {number}"
        case "schedule", [*steps]:
            return f"a schedule of {len(steps)} tasks"
        case "overtaken", [begun, _, left_ms, counts]:
            return f"{begun} begins before {len(counts)} tasks, {left_ms} ms away"
        case "team_time", int():
            return "what time it is"
        case "travel_times", [places, _]:
            return f"travel times between {len(places)} places"
    scope = parse_activation(parts[0])
    return f"{kind} {scope.subject or f'node {scope.node}'}"


def _answer_text(answer: dict[str, Any]) -> str:
    """What became of a command."""
    if "refused" in answer:
        return f"{answer['cause']}: {answer['refused']}"
    state = " ".join(f"{name}={value}" for name, value in answer["state"].items())
    return f"{'kept' if answer['kept'] else 'taken' if answer['taken'] else 'newer'}, {state}"
