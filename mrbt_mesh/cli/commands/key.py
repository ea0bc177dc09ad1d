"""`mrbt key`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from mrbt_mesh.cli.framework.declare import argument


def key(path: Annotated[Path, argument("FILE", "A file that does not exist yet.")]) -> None:
    """Make a key for a team on the transport wireless: who holds it may take part.

    Example: mrbt key team.pem, copy it to every robot, then there:
    mrbt agent --transport wireless --key team.pem --keys keys --mission MISSION --robot A1
    """
    import click

    from mrbt_mesh.errors import InputError
    from mrbt_mesh.runtime.team_key import write_team_key

    try:
        write_team_key(path)
    except FileExistsError:
        raise InputError(f"{path} exists already: choose another name, or remove it") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}") from None
    click.echo(f"wrote {path}; keep it as secret as a password")
