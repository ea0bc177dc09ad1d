"""Teams of real processes in the situations that a view has to make clear at a glance."""

from __future__ import annotations

import re
import signal
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.missions import write_mission
from tests.support.team import REPAIR, Team

HELD = "do_diagnosis(2)"
_PROGRAM = """\
import anyio
from mrbt_mesh import RobotProgram, TaskContext

robot = RobotProgram(record_work=True)


@robot.local_task("*")
async def work(task: TaskContext, place: str) -> None:
    length_s = 4 + sum(map(ord, task.local_task + place)) % 9
    for percent in range(100):
        task.report_progress(percent / 100)
        await anyio.sleep(length_s / 100)
"""


@dataclass(frozen=True)
class Scene:
    """A team in its situation; `url`: its page, with commands unless the run is over."""

    team: Team
    url: str


def address(text: str) -> str:
    """The address of a page that a command has printed."""
    found = re.search(r"web: (\S+)", text)
    assert found is not None, text
    return found[1]


def _up(team: Team, mission: Path, *options: str, speed: float = 10) -> Scene:
    team.up(mission, "--web", "--control", *options, speed=speed)
    team.wait_for_line("web: ")
    return Scene(team, address(team.lines()))


def _blocked(team: Team) -> Scene:
    """One of the two robots that lift the cover dies before."""
    team.hold("use_screwdriver")
    scene = _up(team, REPAIR)
    team.wait_for_events(2, "use_screwdriver")
    team.signal("C1", signal.SIGKILL)
    team.wait_for_line("C1 is dead")
    team.release()
    team.wait_for_line("blocked:")
    return scene


def _dead(team: Team) -> Scene:
    """A robot dies at its work, and another one takes over."""
    team.hold(HELD)
    scene = _up(team, REPAIR, speed=1)
    event = team.wait_for_work(team.wait_for_event("do_diagnosis", args=["2"]))
    team.signal(event["robot"], signal.SIGKILL)
    team.wait_for_work(team.wait_for_replacement(event))
    return scene


def inspection(folder: Path, robots: int, aisles: int) -> Path:
    """Cleaners and inspectors in a warehouse, 7 nodes of the tree an aisle, without an end."""
    one: dict[str, Any] = {"min": 1, "max": 1}
    tasks = {
        f"{local}_aisle": {"parameters": ["aisle"], "needs": {f"{local}($aisle)": one}}
        for local in ("clean", "inspect", "scan")
    }
    names = [f"{'cleaner' if i % 3 == 0 else 'inspector'}_{i:02}" for i in range(1, robots + 1)]
    places = [f"aisle_{i:03}" for i in range(1, aisles + 1)]
    work = {"Sequence": ["clean_aisle($aisle)", "inspect_aisle($aisle)", "scan_aisle($aisle)"]}
    visit = {"Fallback": [{"Condition": "closed($aisle)"}, work]}
    mission = {
        "mission": "warehouse_inspection",
        "parameters": {"aisles": places},
        "conditions": {"closed": {"parameters": ["aisle"], "default": False}},
        "local_tasks": {
            local: {"parameters": ["place"], "work": 8} for local in ("clean", "inspect", "scan")
        },
        "robot_types": {
            "cleaner": {"capabilities": {"clean": 1, "scan": 0.5}},
            "inspector": {"capabilities": {"inspect": 1, "scan": 1}},
        },
        "robots": {name: name.partition("_")[0] for name in names},
        "global_tasks": tasks,
        "tree": {
            "Parallel": {
                "success": "all",
                "for_each": {"aisle": "$aisles"},
                "do": {"Repeat": {"cycles": -1, "do": visit}},
            }
        },
    }
    return write_mission(folder, mission, _PROGRAM)


def _many(team: Team) -> Scene:
    """24 robots: two die at work, one is frozen, one has lost a capability."""
    scene = _up(team, inspection(team.folder, 24, 18), speed=1)
    for local_task, count in (("clean", 10), ("inspect", 8)):
        line = team.wait_for_events(count, local_task)[-1]
        team.signal(line["robot"], signal.SIGKILL)
        team.wait_for_line(f"{line['robot']} is dead")
    team.mrbt("fault", "inspector_05", "inspect", "--run-dir", str(team.run_dir))
    team.signal("inspector_08", signal.SIGSTOP)
    team.wait_for_line("inspector_08 is dead")
    return scene


def _large(team: Team) -> Scene:
    """A tree of 600 nodes; one of eight robots dies when a third of the work is done."""
    scene = _up(team, inspection(team.folder, 8, 86), speed=1)
    line = team.wait_for_events(12, "inspect")[-1]
    team.signal(line["robot"], signal.SIGKILL)
    team.wait_for_line(f"{line['robot']} is dead")
    return scene


def _ended(team: Team) -> Scene:
    """A run that is over, with a death in it."""
    scene = _dead(team)
    team.release()
    team.wait_for_line("stays until Ctrl-C")
    team.interrupt()
    team.end()
    web = team.start("watch", "--web", "--run-dir", str(team.run_dir), "--port", "0")
    assert web.stdout is not None
    return Scene(scene.team, address(web.stdout.readline()))


SITUATIONS: dict[str, Callable[[Team], Scene]] = {
    "blocked": _blocked,
    "dead": _dead,
    "robots-24": _many,
    "nodes-600": _large,
    "ended": _ended,
}


@contextmanager
def situation(name: str) -> Iterator[Scene]:
    """A team in this situation, ended with the block."""
    folder = tempfile.TemporaryDirectory(prefix="mrbt-picture-")
    with folder, Team(Path(folder.name)) as team:
        yield SITUATIONS[name](team)
