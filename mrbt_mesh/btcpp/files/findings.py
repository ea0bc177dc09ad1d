"""Findings of a check: errors and warnings, some of which become errors with `--strict`."""

from __future__ import annotations

import enum
from collections.abc import Iterable
from dataclasses import dataclass, field

from mrbt_mesh.errors import FileError, Problem

MAX_FINDINGS = 500


class Severity(enum.StrEnum):
    """`ERROR`: the file cannot be used. `WARNING`: it can be used, but breaks a rule or is odd."""

    ERROR = "error"
    WARNING = "warning"


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing found; `str()` gives `file:line: path: message`."""

    severity: Severity
    problem: Problem

    def __str__(self) -> str:
        return str(self.problem)

    def to_json(self) -> dict[str, str | int]:
        """Return the finding as plain data."""
        problem = self.problem
        return {
            "severity": str(self.severity),
            "file": problem.file,
            "line": problem.line,
            "path": problem.path,
            "message": problem.message,
        }


@dataclass
class Findings:
    """Collects findings. With `is_strict`, breaking any rule of BehaviorTree.CPP is an error."""

    is_strict: bool = False
    found: dict[Finding, None] = field(default_factory=dict)

    def error(self, file: str, line: int, path: str, message: str) -> None:
        """Add an error, which makes the file unusable."""
        self._add(Severity.ERROR, Problem(file, line, path, message))

    def rule(self, file: str, line: int, path: str, message: str) -> None:
        """Add a broken rule that leaves the file's meaning clear: an error if strict."""
        severity = Severity.ERROR if self.is_strict else Severity.WARNING
        self._add(severity, Problem(file, line, path, message))

    def warn(self, file: str, line: int, path: str, message: str) -> None:
        """Add a warning: the file is valid here, but probably not as intended."""
        self._add(Severity.WARNING, Problem(file, line, path, message))

    def warn_all(self, problems: Iterable[Problem]) -> None:
        """Add problems found elsewhere as warnings."""
        for problem in problems:
            self._add(Severity.WARNING, problem)

    def _add(self, severity: Severity, problem: Problem) -> None:
        if not self.is_full:
            self.found[Finding(severity, problem)] = None

    @property
    def is_full(self) -> bool:
        """True if the limit is reached; further findings are dropped."""
        return len(self.found) >= MAX_FINDINGS

    @property
    def errors(self) -> list[Finding]:
        """The errors, in file order."""
        return [finding for finding in self.in_order() if finding.severity is Severity.ERROR]

    @property
    def warnings(self) -> list[Finding]:
        """The warnings, in file order."""
        return [finding for finding in self.in_order() if finding.severity is Severity.WARNING]

    def in_order(self) -> list[Finding]:
        """Return all findings, file by file, in the order of their lines."""
        files = {finding.problem.file: None for finding in self.found}
        order = {file: number for number, file in enumerate(files)}
        return sorted(self.found, key=lambda f: (order[f.problem.file], f.problem.line))

    def raise_errors(self) -> None:
        """Raise FileError if there is any error."""
        if self.errors:
            raise FileError(finding.problem for finding in self.errors)
