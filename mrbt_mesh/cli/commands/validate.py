"""`mrbt validate`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from mrbt_mesh.cli.framework.declare import option
from mrbt_mesh.cli.options import JsonOption, MissionArgument


def validate(
    mission: MissionArgument,
    compile_to: Annotated[
        Path | None, option("Also write the compiled mission here.", "FILE", name="--compile")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Check a mission file; say what it holds.

    Example: mrbt validate examples/vehicle_repair/mission.yaml
    """
    from mrbt_mesh.analysis.cautions import cautions
    from mrbt_mesh.cli.framework.terminal import console, labelled, print_json, write_file
    from mrbt_mesh.formats.mission_file import compile_mission, load_mission, mission_warnings

    loaded = load_mission(mission)
    warnings = [*mission_warnings(loaded), *cautions(loaded)]
    if compile_to is not None:
        write_file(compile_to, compile_mission(loaded))
    counts = {
        "robots": len(loaded.robots),
        "local_tasks": len(loaded.local_tasks),
        "global_tasks": len(loaded.global_tasks),
        "tree_nodes": len(loaded.tree.nodes),
    }
    if as_json:
        print_json(
            {"mission": loaded.name, "digest": loaded.digest, **counts, "warnings": warnings}
        )
        return
    listed = ", ".join(f"{count} {name.replace('_', ' ')}" for name, count in counts.items())
    console.print(f"[bold green]valid[/] {loaded.name}: {listed}")
    for warning in warnings:
        console.print(labelled("warning", "yellow", warning), soft_wrap=True)
