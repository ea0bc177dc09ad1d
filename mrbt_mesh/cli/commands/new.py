"""`mrbt new`: a mission and a robot of one's own."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from shlex import quote
from typing import Any

import click

from mrbt_mesh.cli.command import PATH, MrbtCommand, with_options
from mrbt_mesh.errors import InputError
from mrbt_mesh.formats.shipped import examples
from mrbt_mesh.plugins import PROGRAMS

KINDS = {name: PROGRAMS.load(name) for name in PROGRAMS.names()}


def kind_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """Add a flag for each installed kind of robots."""
    flags = [click.option(f"--{name}", is_flag=True, help=k.summary) for name, k in KINDS.items()]
    return with_options(function, flags)


@click.command(cls=MrbtCommand)
@click.argument("folder", metavar="FOLDER", type=PATH, help="A folder that does not exist yet.")
@click.option("--example", metavar="NAME", help=f"Copy this example: {', '.join(examples())}.")
@kind_options
def new(folder: Path, example: str | None, **flags: bool) -> None:
    """Write a small mission and a robot of your own that run at once, or copy an example.

    Example: mrbt new my_team && mrbt up my_team/mission.yaml
    """
    from mrbt_mesh.formats import shipped

    kinds = [name for name, is_given in flags.items() if is_given]
    chosen = [*(["--example"] if example else []), *(f"--{name}" for name in kinds)]
    if len(chosen) > 1:
        raise InputError(f"{' and '.join(chosen)}: choose one of them")
    kind = KINDS[kinds[0]] if kinds else None
    try:
        if example is not None:
            files = shipped.example_files(example)
        else:
            name = shipped.mission_name(folder.resolve().name)
            template = kind.template if kind is not None else shipped.TEMPLATE
            files = shipped.template_files(name, template)
        written = shipped.write_files(folder, files)
    except OSError as error:
        raise InputError(f"{folder}: cannot be written: {error.strerror}") from None
    for path in written:
        click.echo(f"wrote {path}")
    hint = kind.hint.format(folder=quote(str(folder))) if kind is not None else ""
    steps = [hint, "then, beside it: "] if hint else ["now: "]
    click.echo("\n" + "\n".join(steps) + f"mrbt up {quote(str(folder / 'mission.yaml'))}")
