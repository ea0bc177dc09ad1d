"""What the checks of recordings find: what is wrong, and why robots took over work."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.core.planning.plan import Plan
from mrbt_mesh.recording.reader import RecordedMessage, Recording
from mrbt_mesh.recording.recorded_state import RecordedState


@dataclass(frozen=True)
class RecordingFinding:
    """`record`: the number of the record in its file, 0 for the whole file; `at_us` counts from the
    begin of the recording. `against`: the other recordings that contradict it.
    """

    file: str
    record: int
    at_us: int
    text: str
    against: tuple[str, ...] = ()

    def __str__(self) -> str:
        place = f"{self.file}: record {self.record}" if self.record else self.file
        contradicted = f" (contradicted by {', '.join(self.against)})" if self.against else ""
        return f"{place}: {self.text}{contradicted}"


@dataclass(frozen=True)
class ProvedTakeover:
    """A robot began the work of another one; `cause`: why that one no longer does it.

    `at_us` counts from the begin of its recording.
    """

    at_us: int
    robot: str
    of: str
    activation: str
    local_task: str
    cause: str


@dataclass(frozen=True)
class Verification:
    """The result: numbers of what was checked by kind, findings, takeovers.

    `notes` say what could not be checked: e.g. a recording that is cut off.
    """

    files: tuple[str, ...]
    counts: Mapping[str, int]
    findings: tuple[RecordingFinding, ...]
    takeovers: tuple[ProvedTakeover, ...]
    notes: tuple[str, ...]

    @property
    def is_good(self) -> bool:
        """Whether everything that was recorded is proved."""
        return not self.findings

    def to_json(self) -> dict[str, Any]:
        """Plain data; times in microseconds."""
        return {
            "verified": self.is_good,
            "files": list(self.files),
            "counts": dict(self.counts),
            "findings": [asdict(each) for each in self.findings],
            "takeovers": [asdict(each) for each in self.takeovers],
            "notes": list(self.notes),
        }


class CheckedState:
    """The check of one recording so far: what its robot knew, and what was found.

    `plan`: the newest one, as the check has made it again.
    """

    def __init__(self, recording: Recording, mission: Mission) -> None:
        self.recording = recording
        self.state = RecordedState(TeamFacts(mission, recording.metadata.run))
        self.plan: Plan | None = None
        self.findings: list[RecordingFinding] = []
        self.takeovers: list[ProvedTakeover] = []
        self.counts: Counter[str] = Counter()

    def say(self, record: RecordedMessage, text: str) -> None:
        """Add a finding about a record."""
        at_us = max(0, record.at_us - self.recording.begin_us)
        name = self.recording.name
        self.findings.append(RecordingFinding(name, record.number, at_us, text))
