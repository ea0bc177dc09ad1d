"""The keys of a run on one machine: made by whoever starts it, in its run directory."""

from __future__ import annotations

from mrbt_mesh.core.membership.keys import Role
from mrbt_mesh.runtime.key_folder import OPERATOR, KeyFolder
from mrbt_mesh.runtime.run_dir import RunDir, RunInfo


def ensure_member(run_dir: RunDir, info: RunInfo, robot: str) -> None:
    """See that a robot of this run has a key, and its team with an operator.

    Robots that run already take over the new manifest. Raises KeysError.
    """
    folder = KeyFolder(run_dir.keys_path)
    if not folder.manifest_path.exists():
        members = dict.fromkeys([*info.robots, robot], Role.ROBOT)
        operator = OPERATOR
        while operator in members:
            operator += "_"
        KeyFolder.create(folder.path, {**members, operator: Role.OPERATOR})
    elif robot not in folder.manifest().members:
        folder.add({robot: Role.ROBOT})
