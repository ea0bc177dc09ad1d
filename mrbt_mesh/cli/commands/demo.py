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

    The address of a live page is printed, where the extra `web` is installed: it shows the robots
    in the browser, and has a button to kill each.

    Exit status: as of `mrbt up`.

    Example: mrbt demo; in a second terminal, while it runs: mrbt kill A1; mrbt status
    """
    import click

    from mrbt_mesh.cli.commands.up import LaunchOptions, up
    from mrbt_mesh.cli.framework.declare import Given
    from mrbt_mesh.cli.team.page_options import WebOptions, has_extra
    from mrbt_mesh.cli.team.show_options import ShowOptions
    from mrbt_mesh.formats.shipped import example_mission

    mission = example_mission(example)
    if not as_json:
        click.echo(f"mrbt up {mission}")
    up(
        mission=mission,
        launch=LaunchOptions(speed=speed),
        show=ShowOptions(headless, as_json),
        web=has_extra() and not as_json,
        page=WebOptions(control=True),
        given=Given(()),
    )
