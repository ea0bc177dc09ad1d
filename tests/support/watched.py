"""Small teams in memory that an observer follows; each is some lines for a `Script`."""

from __future__ import annotations

from collections.abc import Sequence

from mrbt_mesh.observer.observer import Observer
from tests.support.script import Script

# A welds and B could, then both are needed; C has nothing to do.
COVER = (
    "robot A weld lift",
    "robot B weld*0.5 lift",
    "robot C look",
    "task cover lift 2..2",
    'tree Sequence("weld", "cover")',
    "observe",
    "start A B C",
    "pass 200",
)
# A welds and B could.
WELD = (
    "robot A weld",
    "robot B weld*0.5",
    'tree "weld"',
    "observe",
    "start A B",
    "pass 200",
)
# A welds, and nobody else can.
ALONE = (
    "robot A weld lift",
    "robot C look",
    "task weld weld 1..1",
    'tree "weld"',
    "observe",
    "start A C",
    "pass 200",
)


def watched(team: Sequence[str], *commands: str) -> tuple[Script, Observer]:
    """A team's script, with these commands carried out, and its observer."""
    script = Script()
    script.block([*team, *commands])
    observer = script.team.observer
    assert observer is not None
    return script, observer
