"""Results of `mrbt recording verify`: what is proved, what is not, contradictions, takeovers."""

from __future__ import annotations

import enum
from collections.abc import Collection, Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from mrbt_mesh.runtime.command_log import NotedCommand

# Only the robot itself can state these; its key signs that it did.
ON_TRUST = "times, positions and progress are as each robot measured them"


@dataclass(frozen=True)
class RecordingFinding:
    """A contradiction in a file.

    `record`: the number of the record in its file, 0 for the whole file; `at_us` counts from the
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
class ProvedRecording:
    """A member (`by`) is proved to have recorded this until `until_us`, counted from its begin.

    `end`: how it ends, in words.
    """

    file: str
    by: str
    until_us: int
    end: str

    def __str__(self) -> str:
        return f"{self.file}: signed by {self.by} until {self.until_us / 1e6:.3f} s; {self.end}"


class End(enum.StrEnum):
    """How a recording ends.

    CLOSED: its writer ended it. KILLED: others noticed that its robot died. ABRUPT: it has no end,
    and nobody says that its robot died. WRITTEN: a process holds the file.
    """

    CLOSED = "closed"
    KILLED = "killed"
    ABRUPT = "abrupt"
    WRITTEN = "written"


class GapKind(enum.StrEnum):
    """What is not proved.

    Signatures, a robot's recording, the observer's, one that other files name, an end,
    summary.json, commands.jsonl.
    """

    UNSIGNED = "unsigned"
    ROBOT = "robot"
    OBSERVER = "observer"
    NAMED = "named"
    END = "end"
    SUMMARY = "summary"
    COMMANDS = "commands"


@dataclass(frozen=True)
class Gap:
    """Something that is not proved, and what would prove it. `of`: a file or a robot."""

    kind: GapKind
    of: str
    text: str
    remedy: str

    def __str__(self) -> str:
        return f"{self.of}: {self.text}: {self.remedy}"


@dataclass(frozen=True)
class ProvedTakeover:
    """A robot began the work of another one, which had stopped it for this `cause`.

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
    """The result of a verification.

    Counts of checks by kind, what is proved and what is not, contradictions, takeovers. `team_key`:
    the key behind all signatures, empty without one. `notes`: what was left out and why;
    `no_evidence`: files of the run that nothing proves. `commands`: the noted commands of
    operators. `is_running`: the team was at work, and this is of what it had recorded by then.
    `ends`: how each of the `files` ends.
    """

    files: tuple[str, ...]
    team_key: str
    counts: Mapping[str, int]
    proved: tuple[ProvedRecording, ...]
    gaps: tuple[Gap, ...]
    findings: tuple[RecordingFinding, ...]
    takeovers: tuple[ProvedTakeover, ...]
    notes: tuple[str, ...] = ()
    no_evidence: tuple[str, ...] = ()
    commands: tuple[NotedCommand, ...] = ()
    is_running: bool = False
    ends: Mapping[str, End] = field(default_factory=dict)

    @property
    def is_proved(self) -> bool:
        """True if everything is proved."""
        return not self.findings and not self.gaps

    def holds(self, accepted: Collection[str]) -> bool:
        """Return whether nothing is contradicted, and only gaps of the accepted kinds are open."""
        return not self.findings and all(gap.kind in accepted for gap in self.gaps)

    def to_json(self) -> dict[str, Any]:
        """Return plain data; times in microseconds."""
        return {
            "running": self.is_running,
            "all_proved": self.is_proved,
            "files": list(self.files),
            "team_key": self.team_key,
            "counts": dict(self.counts),
            "proved": [asdict(each) for each in self.proved],
            "not_proved": [asdict(each) for each in self.gaps],
            "on_trust": ON_TRUST,
            "notes": list(self.notes),
            "no_evidence": list(self.no_evidence),
            "commands": [asdict(each) for each in self.commands],
            "findings": [asdict(each) for each in self.findings],
            "takeovers": [asdict(each) for each in self.takeovers],
        }
