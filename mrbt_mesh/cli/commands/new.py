"""`mrbt new`: a mission and a robot of one's own."""

from __future__ import annotations

from pathlib import Path

import click

from mrbt_mesh.cli.command import PATH, MrbtCommand
from mrbt_mesh.errors import InputError
from mrbt_mesh.formats.shipped import examples


@click.command(cls=MrbtCommand)
@click.argument("folder", metavar="FOLDER", type=PATH, help="A folder that does not exist yet.")
@click.option("--example", metavar="NAME", help=f"Copy this example: {', '.join(examples())}.")
@click.option("--vda5050", is_flag=True, help="Robots that are AGVs of VDA 5050.")
@click.option("--ros2", is_flag=True, help="For robots of ROS 2, with virtual ones to try it.")
def new(folder: Path, example: str | None, vda5050: bool, ros2: bool) -> None:
    """Write a small mission and a robot of your own that run at once, or copy an example.

    Example: mrbt new my_team && mrbt up my_team/mission.yaml
    """
    from mrbt_mesh.formats import shipped

    given = {"--example": example, "--vda5050": vda5050, "--ros2": ros2}
    chosen = [name for name, value in given.items() if value]
    if len(chosen) > 1:
        raise InputError(f"{' and '.join(chosen)}: choose one of them")
    try:
        if example is not None:
            files = shipped.example_files(example)
        else:
            name = shipped.mission_name(folder.resolve().name)
            files = shipped.template_files(name, "vda5050" if vda5050 else "ros2" if ros2 else "")
        written = shipped.write_files(folder, files)
    except OSError as error:
        raise InputError(f"{folder}: cannot be written: {error.strerror}") from None
    for path in written:
        click.echo(f"wrote {path}")
    if ros2:
        click.echo(f"\nfirst, with ROS 2: python3 {folder / 'virtual_robots.py'} A1 A2 A3")
        click.echo(f"then, beside it: mrbt up {folder / 'mission.yaml'}")
    else:
        click.echo(f"\nnow: mrbt up {folder / 'mission.yaml'}")
