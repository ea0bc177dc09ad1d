"""`mrbt new`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from mrbt_mesh.cli.framework.declare import argument, option
from mrbt_mesh.formats.shipped import examples


def new(
    folder: Annotated[Path, argument("FOLDER", "A folder that does not exist yet.")],
    example: Annotated[
        str | None, option(f"Copy this example: {', '.join(examples())}.", "NAME")
    ] = None,
    ros2: Annotated[bool, option("For robots of ROS 2, with virtual ones to try it.")] = False,
) -> None:
    """Write a small mission and a robot of your own that run at once; or copy an example.

    Example: mrbt new my_team && mrbt up my_team/mission.yaml
    """
    import click

    from mrbt_mesh.errors import InputError
    from mrbt_mesh.formats.template import (
        example_files,
        ros2_files,
        template_files,
        write_files,
    )

    if ros2 and example is not None:
        raise InputError("give either --example or --ros2")
    try:
        files = ros2_files() if ros2 else template_files()
        files = files if example is None else example_files(example)
        written = write_files(folder, files)
    except OSError as error:
        raise InputError(f"{folder}: cannot be written: {error.strerror}") from None
    for path in written:
        click.echo(f"wrote {path}")
    if ros2:
        click.echo(f"\nfirst, with ROS 2: python3 {folder / 'virtual_robots.py'} A1 A2 A3")
        click.echo(f"then, beside it: mrbt up {folder / 'mission.yaml'}")
        return
    click.echo(f"\nnow: mrbt up {folder / 'mission.yaml'}")
