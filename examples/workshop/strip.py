"""A strip of pictures of a takeover in the workshop, from a run in virtual time.

    python examples/workshop/strip.py docs/workshop.png

A robot is killed while it puts a new part in; another one goes on with it. MuJoCo draws without a
screen (EGL; `MUJOCO_GL=osmesa` where there is no EGL).
"""

from __future__ import annotations

import os
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import numpy as np

os.environ.setdefault("MUJOCO_GL", "egl")

from bodies import link
from bodies.messages import HARDWARE

from mrbt_mesh import InputError
from mrbt_mesh.testing import Kill, MissionRun, run

if TYPE_CHECKING:
    from bodies.physics import World

MISSION = Path(__file__).with_name("mission.yaml")
TASK, PART = "replace_hw(2)", "2"
SIZE = (640, 470)
COLOURS = {"A": (0.2, 0.45, 0.8, 1), "B": (0.1, 0.6, 0.5, 1), "C": (0.85, 0.45, 0.2, 1)}
DEAD = (0.35, 0.35, 0.35, 1)
BROKEN, MENDED = (0.85, 0.15, 0.15, 1), (0.2, 0.65, 0.25, 1)
# Seconds between two states that are kept.
EVERY_S = 0.1


@dataclass(frozen=True)
class State:
    """How things lay at one time."""

    time_s: float
    qpos: Any
    new: dict[str, float]


class Film:
    """Keeps how things lie, ten times a second."""

    def __init__(self) -> None:
        self.states: list[State] = []

    def look_on(self, world: World) -> None:
        if not self.states or world.time_s - self.states[-1].time_s >= EVERY_S:
            new = {name: part.done[HARDWARE] for name, part in world.parts.items()}
            self.states.append(State(world.time_s, np.array(world.data.qpos), new))

    def at(self, time_s: float) -> State:
        return min(self.states, key=lambda state: abs(state.time_s - time_s))


def filmed(*faults: tuple[float, Kill]) -> tuple[MissionRun, Film]:
    """The mission in virtual time, and how things lay."""
    film = Film()
    link.onlookers.append(film.look_on)
    try:
        return run(MISSION, faults=faults), film
    finally:
        link.onlookers.remove(film.look_on)


def scenes() -> tuple[Film, list[tuple[float, str | None, str]]]:
    """What is shown: when, who is dead by then, and what is to be said of it."""
    before, _ = filmed()
    dead = before.succeeded(TASK)[0]
    killed_s = next(end.at_s for end in before.ends if end.local_task == TASK) - 0.8
    after, film = filmed((killed_s, Kill(dead)))
    (taken,) = (event for event in after.starts if event.local_task == TASK and event.robot != dead)
    world = link.latest[0]
    (mended,) = (e["at_s"] for e in world.events if e["what"].startswith(f"part {PART}: hardware"))
    other, share = taken.robot, film.at(killed_s).new[PART]
    return film, [
        (killed_s - 0.2, None, f"{dead} puts a new part {PART} in"),
        (killed_s + 0.3, dead, f"{dead} is killed with {share:.0%} done"),
        ((taken.at_s + mended) / 2 - 0.8, dead, f"{other} has taken over and drives there"),
        (mended + 0.1, dead, f"{other} has done what was left"),
    ]


class Painter:
    """Draws states with MuJoCo, robots' names above them."""

    def __init__(self) -> None:
        import mujoco
        from bodies.physics import World

        self._world = World()
        width, height = SIZE
        self._renderer = mujoco.Renderer(self._world.model, height, width)
        self._camera = mujoco.MjvCamera()
        self._camera.lookat[:] = (0.0, 0.1, 0.0)
        self._camera.distance, self._camera.azimuth, self._camera.elevation = 8.4, 90, -60

    def draw(self, state: State, dead: str | None) -> tuple[Any, dict[str, tuple[float, float]]]:
        """Pixels, and where in them the robots are."""
        world = self._world
        for name, robot in world.robots.items():
            colour = DEAD if name == dead else COLOURS[robot.name[0]]
            world.model.geom(f"{name}/body").rgba[:] = colour
        for name, done in state.new.items():
            world.model.geom(f"part_{name}").rgba[:] = MENDED if done >= 1 else BROKEN
        world.data.qpos[:] = state.qpos
        world.settle()
        self._renderer.update_scene(world.data, self._camera)
        places = {name: self._pixel(world.data.xpos[r.base]) for name, r in world.robots.items()}
        return self._renderer.render().copy(), places

    def _pixel(self, place: Any) -> tuple[float, float]:
        """Where a place half a metre above the floor is in the picture."""
        eyes = self._renderer.scene.camera
        eye = (np.array(eyes[0].pos) + np.array(eyes[1].pos)) / 2
        forward, up = np.array(eyes[0].forward), np.array(eyes[0].up)
        towards = place + np.array([0, 0, 0.5]) - eye
        depth = towards @ forward
        half = eyes[0].frustum_top / eyes[0].frustum_near
        width, height = SIZE
        x = (towards @ np.cross(forward, up)) / depth / half
        y = (towards @ up) / depth / half
        return width / 2 + x * height / 2, height / 2 - y * height / 2


@click.command(help=__doc__)
@click.argument("picture", type=click.Path(path_type=Path))
def main(picture: Path) -> None:
    try:
        paint(picture)
    except InputError as error:
        click.echo(f"error: {error}", err=True)
        sys.exit(2)


def paint(picture: Path) -> None:
    """Write the strip. Raises InputError without the extras."""
    try:
        from matplotlib.figure import Figure
    except ImportError:
        raise InputError("pictures need more: pip install 'mrbt-mesh[plot,world]'") from None
    film, shown = scenes()
    painter = Painter()
    figure = Figure(figsize=(4 * len(shown), 3.2), dpi=100)
    figure.subplots_adjust(left=0.005, right=0.995, bottom=0.02, top=0.9, wspace=0.02)
    for number, (time_s, dead, text) in enumerate(shown, 1):
        axes = figure.add_subplot(1, len(shown), number)
        pixels, places = painter.draw(film.at(time_s), dead)
        axes.imshow(pixels)
        for name, (x, y) in places.items():
            if not (20 < x < SIZE[0] - 20 and 30 < y < SIZE[1]):
                continue
            said = f"{name} †" if name == dead else name
            axes.text(x, y - 22, said, ha="center", fontsize=10, fontweight="bold")
        axes.set_title(f"{time_s:.1f} s: {text}", fontsize=11)
        axes.set_axis_off()
    figure.savefig(picture)
    click.echo(f"{picture}: {len(shown)} pictures")


if __name__ == "__main__":
    main()
