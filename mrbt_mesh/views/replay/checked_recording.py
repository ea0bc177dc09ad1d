"""A recording while it is checked: its state at the record that is checked, and what was found."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

from mrbt_mesh.core.facts.store import Entry
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.core.planning.plan import Plan
from mrbt_mesh.recording.reader import RecordedMessage, Recording
from mrbt_mesh.recording.recorded_state import RecordedState
from mrbt_mesh.views.replay.findings import ProvedTakeover, RecordingFinding


class CheckedRecording:
    """`facts`: those in the recording, each with its message; `plan`: as it was made again."""

    def __init__(self, recording: Recording, mission: Mission) -> None:
        self.recording = recording
        self.robot = recording.metadata.robot
        self.state = RecordedState(TeamFacts(mission, recording.metadata.run))
        self.plan: Plan | None = None
        self.findings: list[RecordingFinding] = []
        self.takeovers: list[ProvedTakeover] = []
        self.counts: Counter[str] = Counter()
        self.facts: list[tuple[RecordedMessage, Entry]] = []

    def add_to(self, number: int, text: str) -> None:
        """Add a finding about what is no record; 0: about the whole file."""
        self.add(RecordedMessage(number, "", 0, {}), text)

    def add(self, record: RecordedMessage, text: str, against: Iterable[str] = ()) -> None:
        """Add a finding about a record, which the recordings `against` contradict."""
        at_us = max(0, record.at_us - self.recording.begin_us)
        where = (self.recording.name, record.number, at_us)
        self.findings.append(RecordingFinding(*where, text, tuple(sorted(against))))
