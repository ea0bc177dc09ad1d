"""`mrbt keys revoke`."""

from __future__ import annotations

from typing import Annotated

from mrbt_mesh.cli.framework.declare import argument
from mrbt_mesh.cli.team.key_options import KeysOption


def revoke(
    names: Annotated[tuple[str, ...], argument("NAME...", "Members of the team.")],
    keys: KeysOption = None,
) -> None:
    """Let members' keys count no more; what they had written stands.

    Robots that run with this folder take it over within a second. To others, copy manifest.json.

    Example: mrbt keys revoke B1 --keys keys
    """
    import click

    from mrbt_mesh.cli.team.key_options import chosen_keys

    manifest = chosen_keys(keys).revoke(names)
    click.echo(f"{', '.join(names)}: revoked; version {manifest.version} of the manifest")
