"""The networks and the mission of all measurements."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from benchmarks.missions import write_patrol
from mrbt_mesh.core.membership.timing import Timing
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.formats.mission_file import load_mission
from mrbt_mesh.sim.world.network import Link, LinkKnobs, NetworkKnobs

SECOND_US = 1_000_000
TIMING = Timing()
WARM_UP_US = 10 * SECOND_US


@cache
def mission(robots: int, areas: int) -> Mission:
    """A mission in which robots visit areas."""
    with tempfile.TemporaryDirectory(prefix="mrbt-bench-") as folder:
        names = [name(number) for number in range(robots)]
        areas_named = [f"a{number}" for number in range(areas)]
        return load_mission(write_patrol(Path(folder), names, areas_named))


def name(number: int) -> str:
    return f"R{number:02d}"


@dataclass(frozen=True)
class Net:
    """One kind of network; `links` are those that break after the start, as `0>1` or `0-1`."""

    loss_percent: int = 0
    jitter_ms: int = 0
    links: str = ""

    def knobs(self) -> NetworkKnobs:
        """No tokens: only heartbeats are measured here."""
        link = LinkKnobs(
            jitter_us=1_000 * (self.jitter_ms or 1), loss_permille=10 * self.loss_percent
        )
        return NetworkKnobs(link, token_delay_us=None)

    def blocked(self) -> list[Link]:
        found = []
        for text in self.links.split():
            one, other = name(int(text[0])), name(int(text[2]))
            found += [(one, other)] + [(other, one)] * (text[1] == "-")
        return found

    def __str__(self) -> str:
        parts = [f"{self.loss_percent} % loss"]
        if self.jitter_ms:
            parts.append(f"{self.jitter_ms} ms jitter")
        if self.links:
            broken = "broken link" if "-" in self.links else "one-way link"
            parts.append(broken if len(self.links.split()) == 1 else "one link, another one way")
        return ", ".join(parts)


GRADED = [Net(loss, jitter) for jitter in (0, 200) for loss in (0, 10, 20, 30, 40, 50)]
BROKEN = [Net(*rough, links) for links in ("0>1", "0-1") for rough in ((0, 0), (30, 200))]
BAD = Net(30, 200)
ROUGH = Net(30, 200, "0>1 2-3")
