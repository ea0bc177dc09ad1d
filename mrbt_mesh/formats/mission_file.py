"""Load missions: YAML as people write it, or the compiled JSON that robots are given.

Reading YAML needs pydantic and ruamel.yaml, which cost a robot's process tens of megabytes; they
are imported only when a YAML file is read.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from mrbt_mesh.core.mission.compiled import compile_mission, mission_from_compiled
from mrbt_mesh.core.mission.mission import Mission, performance
from mrbt_mesh.core.mission.names import type_name
from mrbt_mesh.errors import FileError, Problem, read_limited, whole_file_error

__all__ = ["FileError", "Problem", "compile_mission", "load_mission", "mission_warnings"]

# A small mission file may expand into a large tree.
MAX_COMPILED_BYTES = 16 << 20


def load_mission(path: Path) -> Mission:
    """Load the mission in a `.yaml`, `.yml` or compiled `.json` file.

    `program` becomes an absolute path, with its `:name` if it has one. Raises only FileError,
    whatever is wrong with the file.
    """
    file = str(path)
    suffix = Path(path).suffix.lower()
    if suffix not in (".yaml", ".yml", ".json"):
        raise whole_file_error(file, "a mission file ends in .yaml, .yml or .json")
    folder = Path(path).parent
    if suffix == ".json":
        return _load_compiled(read_limited(Path(path), MAX_COMPILED_BYTES), file, folder)
    # Imported here to keep the processes of robots small, see above.
    from mrbt_mesh.formats.build import mission_from_yaml
    from mrbt_mesh.formats.yaml_source import MAX_YAML_BYTES, decode

    return mission_from_yaml(decode(read_limited(Path(path), MAX_YAML_BYTES), file), file, folder)


def _load_compiled(content: bytes, file: str, folder: Path) -> Mission:
    try:
        text = content.decode("utf-8")
    except UnicodeDecodeError:
        raise whole_file_error(
            file, "not a text file in UTF-8; compile the mission again"
        ) from None
    mission = mission_from_compiled(text, file)
    if mission.program is None:
        return mission
    # An absolute path, as compiling writes it, is kept.
    return replace(mission, program=str(folder.resolve() / mission.program))


def mission_warnings(mission: Mission) -> list[str]:
    """Warn of likely mistakes: global tasks that this team can never do, robots that no task can
    use.
    """
    warnings = []
    for task in mission.all_tasks():
        for need in task.needs:
            able = [
                robot.id
                for robot in mission.robots.values()
                if _may_do(robot.capabilities, need.local_task)
            ]
            if len(able) < need.min_robots:
                who = ", ".join(able) or "none"
                warnings.append(
                    f"{task.id} needs {need.min_robots} robots that can do {need.local_task}; "
                    f"this mission has {len(able)} ({who})"
                )
    used = {*mission.local_task_types.values()}
    for robot in mission.robots.values():
        if not any(type_name(ground) in used for ground in robot.capabilities):
            warnings.append(f"robot {robot.id} can do nothing that the tree asks for")
    return warnings


def _may_do(capabilities: Mapping[str, int], local_task: str) -> bool:
    """True if a robot can do the local task; with a placeholder, if it can for some job."""
    if "{" in local_task:
        return type_name(local_task) in map(type_name, capabilities)
    return performance(capabilities, local_task) is not None
