"""The state shared by the parts of one agent: its facts, its view of the team, its effects.

Each part takes this and the few other parts that it needs, never the agent.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from mrbt_mesh.core.agent.commands_on_disk import CommandsOnDisk
from mrbt_mesh.core.agent.config import AgentConfig
from mrbt_mesh.core.agent.effects import Ask, Effect, Log, Persist, Publish, Reply, Stop
from mrbt_mesh.core.agent.sealing import Sealing
from mrbt_mesh.core.agent.wall_clock import WallClock
from mrbt_mesh.core.agent.work import Work
from mrbt_mesh.core.facts import records
from mrbt_mesh.core.facts.description import Description
from mrbt_mesh.core.facts.records import Claim, ConditionValue, NoClaim
from mrbt_mesh.core.facts.store import Entry, Fact, Incarnation
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.membership.joining import Joining
from mrbt_mesh.core.membership.membership import Membership
from mrbt_mesh.core.membership.peer_clocks import PeerClocks
from mrbt_mesh.core.membership.replica import Durability, Replica
from mrbt_mesh.core.membership.signed_reports import SignedReports
from mrbt_mesh.core.membership.wire import (
    DIGEST_BYTES,
    Header,
    MessageKind,
    Position,
    RecordingHead,
    encode,
)
from mrbt_mesh.core.mission.conditions import Value
from mrbt_mesh.core.mission.mission import Mission

MAX_REASONS = 1_000
OTHERS = "others: too many to tell apart"


class Context:
    """One robot's facts, peers and outgoing effects.

    `joining`: None once the robot has joined. `is_leaving`: it is about to leave the team.
    `refused` counts refusals by source and reason; beyond `MAX_REASONS` different ones, new ones
    are counted together. `sealing`: None in a team without keys. `wall_clock`: None in a mission
    without jobs. `position`: the last one that the program reported. `recorded`: how far the
    robot's recording is signed.
    """

    def __init__(self, mission: Mission, config: AgentConfig, now_us: int) -> None:
        self.config = config
        self.me = config.robot
        self.facts = TeamFacts(mission, config.run, config.robot)
        header = Header(mission.team_digest[:16], mission.name, config.run, config.robot)
        read_batch = config.engine.read_batch
        self.replica = Replica(
            self.facts, header, config.timing, config.nonce, read_batch, config.keys
        )
        self.replica.restore(config.restored)
        self.durability = Durability(
            config.journal_problem, bool(config.journal_problem), config.keeps_journal
        )
        self.commands_on_disk = CommandsOnDisk(self.durability)
        # The mission in force, as in its file. It follows `facts.in_force`.
        self.mission = self.facts.in_force
        self.membership = Membership(
            self.me, config.timing, self.mission.robots, SignedReports(config.keys, config.run)
        )
        self.peer_clocks = PeerClocks(config.timing)
        self.wall_clock: WallClock | None = None
        self.use(self.mission)
        self.joining: Joining | None = Joining(
            config.timing,
            config.expected - {self.me},
            now_us,
            gather_us=config.gather_us,
            alone_after_us=config.alone_after_us,
        )
        self.description = Description(
            self.me, config.type, config.capabilities, config.software, config.host, config.pid
        )
        self.description.may_promise = not config.journal_problem
        self.work = Work()
        self.position: Position | None = None
        self.recorded: RecordingHead | None = None
        self.refused: dict[str, int] = {}
        self.is_leaving = False
        self.has_stopped = False
        self.sealing = Sealing(config.keys, config.run, config.life) if config.keys else None
        self._effects: list[Effect] = []

    def use(self, mission: Mission) -> None:
        """Use this mission, which is in force from now on."""
        self.mission = mission
        if mission.jobs and self.wall_clock is None:
            self.wall_clock = WallClock(self.membership, self.config.timing.heartbeat_us)

    def note_position(self, position: Position) -> None:
        """Note where the robot is, as its program reports; heartbeats carry this."""
        self.position = position

    def note_recorded(self, head: RecordingHead) -> None:
        """Note how far the recording is signed; heartbeats carry this."""
        self.recorded = head

    # -- its state ----------------------------------------------------------------------------

    @property
    def has_place(self) -> bool:
        """True once this incarnation has joined, even if it may have to catch up."""
        return self.joining is None or self.joining.keeps_life

    @property
    def is_new(self) -> bool:
        """True until this incarnation has joined. Facts written before would lose to those of
        earlier incarnations.
        """
        return self.joining is not None and self.joining.is_first

    def alive(self) -> dict[str, Incarnation]:
        """The plan's alive set, including this robot."""
        return self.membership.members() | {self.me: self.replica.incarnation}

    def member(self) -> Fact:
        """The fact in which this robot describes itself."""
        return records.MEMBER, self.description.member(self.is_leaving)

    @property
    def place(self) -> str:
        """Where this robot is, or has set out from, even if the mission now lacks the place."""
        said = self.facts.map.get(self.me, records.CLAIM)
        known = said.record.place if said and isinstance(said.record, Claim | NoClaim) else ""
        return self.work.place or known or self.facts.place_of(self.me)

    def claim(self) -> Fact:
        """The fact about what this robot works on, and where it is."""
        return records.CLAIM, self.work.claim or NoClaim(self.place)

    def last_word(self, name: str) -> Value | None:
        """The value that this robot itself last wrote for a condition."""
        entry = self.facts.map.get(self.me, f"{records.CONDITION}/{name}")
        if entry is not None and isinstance(entry.record, ConditionValue):
            return entry.record.value
        return self.mission.entries.default_of(name)

    # -- effects ------------------------------------------------------------------------------

    def write(self, facts: Sequence[Fact], now_us: int) -> None:
        """Write one non-empty batch of facts to the journal and to the team.

        It does not wait for the disk: facts that others rely on are written by `promise`.
        """
        self._write(facts, 0, now_us)

    def promise(self, facts: Sequence[Fact], now_us: int) -> int:
        """Write one batch of facts. Returns its number, by which to know when it is on disk."""
        number = self.durability.take_number()
        self._write(facts, number, now_us)
        return number

    def _write(self, facts: Sequence[Fact], number: int, now_us: int) -> None:
        data, entries = self.replica.write(facts, now_us)
        for problem in self.replica.left_out:
            if self.count_refusal(self.me, "own fact that others would refuse"):
                self.log("error", "own_fact_left_out", problem=problem)
        self.replica.left_out.clear()
        self._effects += (Persist(entries, True, number), Publish(MessageKind.FACT, data))

    def members_digest(self) -> bytes:
        """A digest of the members as this robot sees them; zeros until it has joined."""
        if not self.has_place:
            return bytes(DIGEST_BYTES)
        return self.membership.around.members_digest(self.replica.incarnation)

    def ask(self, peers: Iterable[str], now_us: int) -> None:
        """Pull the facts that this robot lacks from these peers."""
        alive = self.members_digest()
        for peer in peers:
            self.replica.anti_entropy.mark_asked(peer, now_us)
            self._effects.append(Ask(peer, self.replica.write_pull(alive)))

    def answer(self, query: int, good: bool, found: str | dict[str, Any]) -> None:
        """Answer an operator: whether a word was obeyed and a text, or what became of a command."""
        data = encode(self.replica.header, MessageKind.ANSWER, [good, found])
        self._effects.append(Reply(query, (data,)))

    def keep(self, entries: Sequence[Entry]) -> None:
        """Have facts of other robots kept in the journal."""
        kinds = {entry.parts[0] for entry in entries}
        commands = [entry.name for entry in entries if entry.author == records.OPERATORS]
        if commands or kinds & records.JOB_KINDS:  # their operators wait until these are on disk
            number = self.durability.take_number()
            self.emit(Persist(tuple(entries), True, number))
            for name in commands:
                self.commands_on_disk.note(name, number)
        elif entries:
            self.emit(Persist(tuple(entries), at_once=False))

    def answer_kept(self) -> None:
        """Answer the queries for commands that the journal holds now."""
        for query, found in self.commands_on_disk.take_answers():
            self.answer(query, True, found)

    def emit(self, *effects: Effect) -> None:
        """Append effects, to be carried out after earlier ones."""
        self._effects += effects

    def log(self, level: str, event: str, **fields: Any) -> None:
        """Write one line to the robot's log."""
        self._effects.append(Log(level, event, fields))

    def refuse(self, source: str, reason: str, incompatible: bool = False, count: int = 1) -> None:
        """Count a refusal; log it once per source and reason."""
        if self.count_refusal(source, reason, count):
            event = "robot_refused" if incompatible else "input_refused"
            self.log("error" if incompatible else "warning", event, source=source, reason=reason)
        if incompatible and self.joining is not None:
            self.joining.refusal = f"{source}: {reason}"

    def count_refusal(self, source: str, reason: str, count: int = 1) -> bool:
        """Add to the count of a refusal. Returns True the first time, when it should be logged."""
        key = f"{source}: {reason}"
        if key not in self.refused and len(self.refused) >= MAX_REASONS:
            key = OTHERS
        self.refused[key] = self.refused.get(key, 0) + count
        return self.refused[key] == count

    def stop(self, code: int, reason: str | None) -> None:
        """Stop the agent for this reason; does nothing if it is None."""
        if reason is not None and not self.has_stopped:
            self.has_stopped = True
            self.emit(*self.work.drop(), Stop(code, reason))

    def take_effects(self) -> list[Effect]:
        """Return the effects so far, in order, and remove them."""
        effects, self._effects = self._effects, []
        return effects if self.sealing is None else [self.sealing.seal(each) for each in effects]
