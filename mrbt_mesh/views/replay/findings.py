"""The findings of the checks of recordings, and the causes of takeovers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any


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
    """A robot began the work of another one, which stopped it for this `cause`.

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

    `notes`: what could not be checked, e.g. a recording that is cut off.
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
