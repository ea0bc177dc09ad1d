"""`mrbt keys`: the keys with which a team authenticates the author of each message."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from mrbt_mesh.cli.command import PATH, CommandGroup
from mrbt_mesh.cli.options import comma_list, json_option
from mrbt_mesh.errors import InputError

if TYPE_CHECKING:
    from mrbt_mesh.runtime.key_folder import KeyFolder

names_argument = click.argument(
    "names", metavar="NAME...", nargs=-1, required=True, help="Members of the team."
)
keys_option = click.option(
    "--keys",
    type=PATH,
    metavar="DIR",
    help="The team's folder of keys. Default: that of the team that runs, or of the newest run.",
)


@click.group(cls=CommandGroup)
def keys() -> None:
    """Make and change the keys of a team.

    Example: mrbt keys init keys --robots A1,B1,C1
    """


@keys.command()
@click.argument("folder", metavar="FOLDER", type=PATH, help="A folder that holds no keys yet.")
@click.option(
    "--robots", required=True, metavar="A1,B1,...", callback=comma_list, help="The team's robots."
)
@click.option(
    "--operators",
    default="operator",
    metavar="NAME,...",
    callback=comma_list,
    help="They may read and command.",
)
@click.option("--observers", metavar="NAME,...", callback=comma_list, help="They may only read.")
@click.option("--routers", metavar="NAME,...", callback=comma_list, help="See `mrbt router`.")
def init(folder: Path, **names: tuple[str, ...]) -> None:
    """Make the keys of a new team.

    A robot's machine needs manifest.json and the robot's own .key file, and nothing else of it.

    Example: mrbt keys init keys --robots A1,B1,C1 --observers screen
    """
    from mrbt_mesh.core.membership.keys import Role
    from mrbt_mesh.runtime.key_folder import TEAM_FILE, KeyFolder

    if not names["robots"]:
        raise InputError("--robots names none: a team has at least one robot")
    members: dict[str, Role] = {}
    for role in (Role.ROBOT, Role.OPERATOR, Role.OBSERVER, Role.ROUTER):
        for name in names[f"{role}s"]:
            if name in members:
                raise InputError(f"{name} is given twice: every member has one name and one role")
            members[name] = role
    KeyFolder.create(folder, members)
    click.echo(f"made keys for {', '.join(members)} in {folder}")
    click.echo(f"keep {folder / TEAM_FILE} as secret as a password: it makes more members")


@keys.command()
@names_argument
@click.option(
    "--role",
    type=click.Choice(("robot", "operator", "observer", "router")),
    default="robot",
    help="A robot takes part, an operator commands, an observer reads, a router passes on.",
)
@click.option(
    "--replace", is_flag=True, help="Also members that have a key, which is no longer valid then."
)
@keys_option
def add(names: tuple[str, ...], role: str, replace: bool, keys: Path | None) -> None:
    """Give keys to more members, or new ones to members that have some.

    Example: mrbt keys add D1 D2 --keys keys
    """
    from mrbt_mesh.core.membership.keys import Role

    manifest = _chosen(keys).add(dict.fromkeys(names, Role(role)), replaces=replace)
    click.echo(f"{', '.join(names)}: {role}; version {manifest.version} of the manifest")


@keys.command()
@names_argument
@keys_option
def revoke(names: tuple[str, ...], keys: Path | None) -> None:
    """Make members' keys invalid; facts that they wrote before remain.

    Robots that run with this folder notice it within a second. To others, copy manifest.json.

    Example: mrbt keys revoke B1 --keys keys
    """
    manifest = _chosen(keys).revoke(names)
    click.echo(f"{', '.join(names)}: revoked; version {manifest.version} of the manifest")


@keys.command()
@keys_option
@json_option
def show(keys: Path | None, as_json: bool) -> None:
    """List the members of a team with their roles and keys.

    Example: mrbt keys show --keys keys
    """
    from mrbt_mesh.cli.terminal import print_json

    folder = _chosen(keys)
    data = _manifest_data(folder)
    if as_json:
        print_json(data)
        return
    click.echo(f"{folder.path}: version {data['version']}, team key {data['team_key'][:16]}")
    for name, member in data["members"].items():
        state = ", revoked" if member["revoked"] else ""
        click.echo(f"{name}: {member['role']}{state}, key {member['key'][:16]}")


def _chosen(path: Path | None) -> KeyFolder:
    from mrbt_mesh.runtime.key_folder import KeyFolder
    from mrbt_mesh.runtime.known_runs import look_up_run

    return KeyFolder(
        path if path is not None else look_up_run(None, "--keys RUN_DIR/keys").keys_path
    )


def _manifest_data(folder: KeyFolder) -> dict[str, Any]:
    manifest = folder.manifest()
    return {
        "folder": str(folder.path),
        "version": manifest.version,
        "team_key": manifest.authority.hex(),
        "members": {
            name: {
                "role": str(member.role),
                "key": member.sign.hex(),
                "former_keys": len(member.former),
                "revoked": member.is_revoked,
            }
            for name, member in sorted(manifest.members.items())
        },
    }
