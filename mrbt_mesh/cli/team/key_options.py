"""The options that say which keys: those of a team's folder, or of the run started last."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from mrbt_mesh.cli.framework.declare import option

if TYPE_CHECKING:
    from mrbt_mesh.runtime.key_folder import KeyFolder
    from mrbt_mesh.runtime.manifest import Manifest

KeysOption = Annotated[
    Path | None, option("The team's folder of keys. Default: that of the run started last.", "DIR")
]


def chosen_keys(path: Path | None) -> KeyFolder:
    """The folder that the option names; raises InputError if it cannot be told which."""
    from mrbt_mesh.runtime.key_folder import KeyFolder
    from mrbt_mesh.runtime.run_dir import RunDir

    return KeyFolder(path if path is not None else RunDir.find(None).keys_path)


def listed(names: str | None) -> list[str]:
    """`A1,B1` as a list."""
    return [name for name in (names or "").split(",") if name]


def manifest_data(folder: KeyFolder, manifest: Manifest) -> dict[str, Any]:
    """A manifest as plain data, for people and programs."""
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
