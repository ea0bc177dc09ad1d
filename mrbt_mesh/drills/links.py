"""Links in the robots' own logs: which fell silent, and when they came back."""

from __future__ import annotations

import json
from collections.abc import Collection, Iterable
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path


@dataclass(frozen=True, slots=True)
class LinkLine:
    """A change of a link in a robot's log.

    `robot` has had no beat from `peer` itself for a lease (`event` link_silent), has one again
    (link_heard), or no longer needs any (link_unwatched).
    """

    unix_s: float
    robot: str
    peer: str
    event: str

    @property
    def back(self) -> bool:
        return self.event == "link_heard"

    @property
    def pair(self) -> frozenset[str]:
        return frozenset((self.robot, self.peer))


def read_links(run_dir: Path, robots: Iterable[str]) -> list[LinkLine]:
    """Return the entries about links in the logs of a run, by time."""
    found = []
    for robot in robots:
        try:
            text = (run_dir / f"{robot}.log").read_text(encoding="utf-8")
        except OSError:
            continue
        # A killed robot's last line may be incomplete.
        for line in map(json.loads, text[: text.rfind("\n") + 1].splitlines()):
            if line["event"] in ("link_silent", "link_heard", "link_unwatched"):
                unix_s = datetime.fromisoformat(line["timestamp"]).timestamp()
                found.append(LinkLine(unix_s, robot, line["peer"], line["event"]))
    return sorted(found, key=lambda line: line.unix_s)


def silent_at_the_end(lines: Iterable[LinkLine]) -> list[LinkLine]:
    """Return the last entry about each link that was needed and not heard again."""
    last = {(line.robot, line.peer): line for line in lines}
    return [line for line in last.values() if line.event == "link_silent"]


def slow_returns(
    lines: Iterable[LinkLine], heals_unix_s: Collection[float], limit_s: float
) -> list[tuple[LinkLine, float]]:
    """Return links that came back more than `limit_s` after the last healing, with that time."""
    late = []
    for line in lines:
        before = [at_s for at_s in heals_unix_s if at_s <= line.unix_s]
        if line.back and before and line.unix_s - max(before) > limit_s:
            late.append((line, line.unix_s - max(before)))
    return late
