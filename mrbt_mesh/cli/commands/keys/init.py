"""`mrbt keys init`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from mrbt_mesh.cli.framework.declare import argument, option


def init(
    folder: Annotated[Path, argument("FOLDER", "A folder that holds no keys yet.")],
    robots: Annotated[str, option("The team's robots.", "A1,B1,...")],
    operators: Annotated[str, option("Who may read and command.", "NAME,...")] = "operator",
    observers: Annotated[str | None, option("Who may only read.", "NAME,...")] = None,
    routers: Annotated[str | None, option("Routers: see `mrbt router`.", "NAME,...")] = None,
) -> None:
    """Make the keys of a new team.

    A robot's machine needs manifest.json and the robot's own .key file, nothing else of it.

    Example: mrbt keys init keys --robots A1,B1,C1 --observers screen
    """
    import click

    from mrbt_mesh.cli.team.key_options import listed
    from mrbt_mesh.core.membership.keys import Role
    from mrbt_mesh.errors import InputError
    from mrbt_mesh.runtime.key_folder import TEAM_FILE, KeyFolder

    given = [
        (Role.ROBOT, robots),
        (Role.OPERATOR, operators),
        (Role.OBSERVER, observers),
        (Role.ROUTER, routers),
    ]
    members: dict[str, Role] = {}
    for role, names in given:
        for name in listed(names):
            if name in members:
                raise InputError(f"{name} is given twice: every member has one name and one role")
            members[name] = role
    KeyFolder.create(folder, members)
    click.echo(f"made keys for {', '.join(members)} in {folder}")
    click.echo(f"keep {folder / TEAM_FILE} as secret as a password: it makes more members")
