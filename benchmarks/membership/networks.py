"""The networks and the mission on which everything is measured."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from mrbt_mesh.core.membership.timing import Timing
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.formats.mission_file import load_mission
from mrbt_mesh.sim.world.network import Link, LinkKnobs, NetworkKnobs

SECOND_US = 1_000_000
TIMING = Timing()
WARM_UP_US = 10 * SECOND_US

MISSION = """\
mission: at_work
program: robot.py
parameters: {{areas: [{areas}]}}
local_tasks: {{explore: {{parameters: [area], work: 1}}}}
robot_types: {{R: {{capabilities: {{explore: 1}}}}}}
robots: {{{robots}}}
global_tasks: {{visit: {{parameters: [area], needs: {{explore($area): {{min: 1, max: 1}}}}}}}}
tree:
  Parallel:
    success: all
    for_each: {{area: $areas}}
    do: visit($area)
"""


@cache
def mission(robots: int, areas: int) -> Mission:
    """So many robots, and so many areas for them to visit."""
    with tempfile.TemporaryDirectory(prefix="mrbt-bench-") as folder:
        path = Path(folder) / "mission.yaml"
        (Path(folder) / "robot.py").write_text("")
        names = ", ".join(f"{name(i)}: R" for i in range(robots))
        path.write_text(
            MISSION.format(robots=names, areas=", ".join(f"a{i}" for i in range(areas)))
        )
        return load_mission(path)


def name(number: int) -> str:
    return f"R{number:02d}"


@dataclass(frozen=True)
class Net:
    """One kind of network; `links` are those that break after the start, as `0>1` or `0-1`."""

    loss_percent: int = 0
    jitter_ms: int = 0
    links: str = ""

    def knobs(self) -> NetworkKnobs:
        """No tokens: what is measured here is what beats alone can tell."""
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
