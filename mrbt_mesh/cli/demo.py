"""`mrbt demo`: an example, without a mission file of one's own."""

from __future__ import annotations

from typing import Annotated

import typer

from mrbt_mesh.cli.common import JsonOption, console, input_errors
from mrbt_mesh.cli.up import HeadlessOption, SpeedOption, up
from mrbt_mesh.formats.shipped import example_mission, examples

DEFAULT = "vehicle_repair"


def demo(
    example: Annotated[
        str, typer.Argument(help=f"One of {', '.join(examples())}.", metavar="EXAMPLE")
    ] = DEFAULT,
    speed: SpeedOption = 1.0,
    headless: HeadlessOption = False,
    as_json: JsonOption = False,
) -> None:
    """Run an example: without a name, six robots that repair a vehicle (about 30 s).

    Exit status: as of `mrbt up`.

    Example: mrbt demo; in a second terminal, while it runs: mrbt kill A1; mrbt status
    """
    with input_errors():
        mission = example_mission(example)
    if not as_json:
        console.print(f"mrbt up {mission}", highlight=False, soft_wrap=True)
    up(mission, speed=speed, headless=headless, as_json=as_json)
