"""`mrbt keys add`."""

from __future__ import annotations

from typing import Annotated, Literal

from mrbt_mesh.cli.framework.declare import argument, option
from mrbt_mesh.cli.team.key_options import KeysOption


def add(
    names: Annotated[tuple[str, ...], argument("NAME...", "Members of the team.")],
    role: Annotated[
        Literal["robot", "operator", "observer", "router"],
        option("robot takes part, operator commands, observer reads, router passes on."),
    ] = "robot",
    replace: Annotated[
        bool, option("Also members that have a key: it is replaced, and counts no more.")
    ] = False,
    keys: KeysOption = None,
) -> None:
    """Give keys to more members, or other ones to members that have some.

    Example: mrbt keys add D1 D2 --keys keys
    """
    import click

    from mrbt_mesh.cli.team.key_options import chosen_keys
    from mrbt_mesh.core.membership.keys import Role

    folder = chosen_keys(keys)
    manifest = folder.add(dict.fromkeys(names, Role(role)), replaces=replace)
    click.echo(f"{', '.join(names)}: {role}; version {manifest.version} of the manifest")
