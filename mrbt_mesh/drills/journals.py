"""The successes in the robots' journals."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from mrbt_mesh.core.facts.records import OUTCOME, Outcome
from mrbt_mesh.runtime.journal import read_journals


@dataclass(frozen=True, order=True, slots=True)
class Done:
    """A success of one robot for one local task of one activation.

    `coalition`: the coalition that performed it, if the global task requires one.
    """

    robot: str
    activation: str
    local_task: str
    coalition: str = ""


def read(
    run_dir: Path, robots: Iterable[str], mission: str, run: str
) -> dict[str, frozenset[Done]]:
    """Return robot -> the successes, of any robot, that its journal holds."""
    return {
        robot: frozenset(
            Done(entry.author, *entry.parts[1:])
            for entry in entries
            if entry.name.startswith(f"{OUTCOME}/")
            and isinstance(entry.record, Outcome)
            and entry.record.success
        )
        for robot, entries in read_journals(run_dir, robots, mission, run).items()
    }
