"""A recording while it is checked: its state at the current record, and what was found."""

from __future__ import annotations

import hashlib
import sys
from collections import Counter
from collections.abc import Iterable
from typing import NamedTuple, Protocol

from mrbt_mesh.core.facts.store import Entry, Incarnation, Version
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.core.planning.plan import Plan
from mrbt_mesh.recording.reader import RecordedMessage, Recording
from mrbt_mesh.recording.recorded_state import RecordedState
from mrbt_mesh.views.replay.findings import ProvedTakeover, RecordingFinding


class RecordPlace(Protocol):
    """Something with a number in a recording, and a time."""

    @property
    def number(self) -> int:
        """The number of its record; 0: the whole file."""

    @property
    def at_us(self) -> int:
        """When it was recorded."""


class Where(NamedTuple):
    """A place of which nothing else is known."""

    number: int
    at_us: int


class RecordedFact(NamedTuple):
    """The parts of a fact that are compared: author, name, version, and where it is recorded."""

    number: int
    at_us: int
    author: str
    name: str
    version: Version
    hash: int
    proof: bytes

    @classmethod
    def of(cls, record: RecordedMessage, entry: Entry) -> RecordedFact:
        """Return the fact of a record. A long run has many, so it is small."""
        author, name = sys.intern(entry.author), sys.intern(entry.name)
        signed = entry.proof.hashes + entry.proof.signature if entry.proof is not None else b""
        proof = hashlib.blake2b(signed, digest_size=16).digest()
        return cls(record.number, record.at_us, author, name, entry.version, entry.hash, proof)

    @property
    def place(self) -> tuple[str, str, Incarnation]:
        """The name under which its versions follow one another."""
        return self.author, self.name, self.version.incarnation

    @property
    def whole(self) -> tuple[str, str, Version, int]:
        """What identifies the fact, except its proof."""
        return self.author, self.name, self.version, self.hash


class CheckedRecording:
    """`facts`: the facts in the recording; `plan`: the recomputed plan."""

    def __init__(self, recording: Recording, mission: Mission) -> None:
        self.recording = recording
        self.robot = recording.metadata.robot
        said = recording.metadata
        self.state = RecordedState(TeamFacts(mission, said.run), said.part)
        # Of the robot's own facts, the last before a recording that begins late.
        self.begins_after: Version | None = None
        # The number of the last record of the state at the beginning of such a recording.
        self.state_until = 0
        self.plan: Plan | None = None
        self.findings: list[RecordingFinding] = []
        self.takeovers: list[ProvedTakeover] = []
        self.counts: Counter[str] = Counter()
        self.facts: list[RecordedFact] = []
        # Facts that are false before a Unix time.
        self.timed: list[tuple[RecordedFact, int]] = []

    def add_to(self, number: int, text: str) -> None:
        """Add a finding that is not about a record; 0: about the whole file."""
        self.add(Where(number, 0), text)

    def add(self, record: RecordPlace, text: str, against: Iterable[str] = ()) -> None:
        """Add a finding about a record, which the recordings `against` contradict."""
        at_us = max(0, record.at_us - self.recording.begin_us)
        where = (self.recording.name_at(record.number), record.number, at_us)
        self.findings.append(RecordingFinding(*where, text, tuple(sorted(against))))
