"""How far the check of one recording is: what its owner knew there, and what was found so far."""

from __future__ import annotations

from collections import Counter

from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.core.planning.plan import Plan
from mrbt_mesh.recording.reader import RecordedMessage, Recording
from mrbt_mesh.recording.recorded_state import RecordedState
from mrbt_mesh.views.replay.findings import ProvedTakeover, RecordingFinding


class CheckedState:
    """`plan`: the newest one, as it was made again."""

    def __init__(self, recording: Recording, mission: Mission) -> None:
        self.recording = recording
        self.state = RecordedState(TeamFacts(mission, recording.metadata.run))
        self.plan: Plan | None = None
        self.findings: list[RecordingFinding] = []
        self.takeovers: list[ProvedTakeover] = []
        self.counts: Counter[str] = Counter()

    def say(self, record: RecordedMessage, text: str) -> None:
        """Something is wrong with a record."""
        at_us = max(0, record.at_us - self.recording.begin_us)
        name = self.recording.name
        self.findings.append(RecordingFinding(name, record.number, at_us, text))
