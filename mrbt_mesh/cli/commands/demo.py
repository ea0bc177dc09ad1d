"""`mrbt demo`."""

from __future__ import annotations

from typing import Annotated

from mrbt_mesh.cli.framework.declare import argument
from mrbt_mesh.cli.options import JsonOption, SpeedOption
from mrbt_mesh.cli.team.show_options import HeadlessOption
from mrbt_mesh.formats.shipped import examples


def demo(
    example: Annotated[
        str, argument("EXAMPLE", f"One of {', '.join(examples())}.")
    ] = "vehicle_repair",
    speed: SpeedOption = 1.0,
    headless: HeadlessOption = False,
    as_json: JsonOption = False,
) -> None:
    """Run an example: without a name, six robots that repair a vehicle (about 30 s).

    Exit status: as of `mrbt up`.

    Example: mrbt demo; in a second terminal, while it runs: mrbt kill A1; mrbt status
    """
    import click

    from mrbt_mesh.cli.commands.up import LaunchOptions, up
    from mrbt_mesh.cli.framework.declare import Given
    from mrbt_mesh.cli.team.show_options import ShowOptions
    from mrbt_mesh.formats.shipped import example_mission

    mission = example_mission(example)
    if not as_json:
        click.echo(f"mrbt up {mission}")
    up(mission, LaunchOptions(speed=speed), ShowOptions(headless, as_json), Given(()))
