"""What the robots' journals hold, read from copies: a journal is its robot's alone."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mrbt_mesh.core.records import OUTCOME, Outcome, split_name
from mrbt_mesh.runtime.journal import Journal

SUFFIX = ".journal"


@dataclass(frozen=True, order=True, slots=True)
class Done:
    """A success of one robot for one local task of one activation.

    `coalition`: the one with which it was done, where the global task asks for that.
    """

    robot: str
    activation: str
    local_task: str
    coalition: str = ""


def read(
    run_dir: Path, robots: Iterable[str], mission: str, run: str
) -> dict[str, frozenset[Done]]:
    """Robot -> the successes that its journal holds, whoever's they are.

    Opening SQLite's files would repair and shorten them, which is left to their robot.
    """
    found = {}
    with tempfile.TemporaryDirectory(prefix="mrbt-journals-") as folder:
        for robot in robots:
            for part in run_dir.glob(f"{robot}{SUFFIX}*"):
                if ".aside-" not in part.name and not part.name.endswith("-shm"):
                    shutil.copy(part, folder)
            journal = Journal(Path(folder) / f"{robot}{SUFFIX}", mission, run, robot, _ignore)
            entries = journal.open()
            journal.close()
            found[robot] = frozenset(
                Done(entry.author, *split_name(entry.name)[1:])
                for entry in entries
                if entry.name.startswith(f"{OUTCOME}/")
                and isinstance(entry.record, Outcome)
                and entry.record.success
            )
    return found


def _ignore(level: str, event: str, **fields: Any) -> None:
    """A journal that cannot be read holds nothing; its robot says so in its own log."""
