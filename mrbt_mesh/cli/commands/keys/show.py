"""`mrbt keys show`."""

from __future__ import annotations

from mrbt_mesh.cli.options import JsonOption
from mrbt_mesh.cli.team.key_options import KeysOption


def show(keys: KeysOption = None, as_json: JsonOption = False) -> None:
    """Tell who has a key, and for what.

    Example: mrbt keys show --keys keys
    """
    import click

    from mrbt_mesh.cli.framework.terminal import print_json
    from mrbt_mesh.cli.team.key_options import chosen_keys, manifest_data

    folder = chosen_keys(keys)
    data = manifest_data(folder, folder.manifest())
    if as_json:
        print_json(data)
        return
    click.echo(f"{folder.path}: version {data['version']}, team key {data['team_key'][:16]}")
    for name, member in data["members"].items():
        state = ", revoked" if member["revoked"] else ""
        click.echo(f"{name}: {member['role']}{state}, key {member['key'][:16]}")
