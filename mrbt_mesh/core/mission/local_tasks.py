"""What a single robot may be asked to do."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class LocalTask:
    """A local-task type: its parameters, and its nominal work in micro-units.

    A robot with performance p needs work / p seconds for it.
    """

    name: str
    parameters: tuple[str, ...] = ()
    work: int = 1_000_000
