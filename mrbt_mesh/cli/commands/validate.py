"""`mrbt validate`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from mrbt_mesh.cli.framework.declare import option
from mrbt_mesh.cli.options import JsonOption, MissionArgument, ProgramOption, RobotsOption


def validate(
    mission: MissionArgument = Path("mission.yaml"),
    compile_to: Annotated[
        Path | None, option("Also write the compiled mission here.", "FILE", name="--compile")
    ] = None,
    program: ProgramOption = None,
    robots: RobotsOption = None,
    as_json: JsonOption = False,
) -> None:
    """Check a mission file and its robots' program; say what it holds.

    The program is imported, and must have a function for each local task of the robots.

    Without a file it is mission.yaml in this folder.

    Example: mrbt validate examples/vehicle_repair/mission.yaml
    """
    from mrbt_mesh.cli.framework.terminal import (
        check_outputs,
        console,
        labelled,
        print_json,
        write_file,
    )
    from mrbt_mesh.cli.missions import chosen_robots, fitting_program
    from mrbt_mesh.errors import FileError, InputError
    from mrbt_mesh.formats.cautions import cautions
    from mrbt_mesh.formats.mission_file import compile_mission, load_mission, mission_warnings
    from mrbt_mesh.runtime.program import functions_of
    from mrbt_mesh.runtime.solver_loader import solver_for

    check_outputs(mission, {"--compile": compile_to})
    loaded = load_mission(mission)
    solver_for(loaded, None)
    team = chosen_robots("--robots", robots, loaded)
    warnings = [*mission_warnings(loaded), *cautions(loaded)]
    reference = program or loaded.program
    if reference is not None:
        code = fitting_program(loaded, team, reference)
        try:
            functions_of(code).check_computer()
        except FileError:
            raise
        except InputError as error:
            # Missions are also checked where no robot runs.
            warnings.append(f"no robot can start on this computer: {error}")
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
            {
                "mission": loaded.name,
                "digest": loaded.digest,
                "program": reference,
                **counts,
                "warnings": warnings,
            }
        )
        return
    listed = ", ".join(f"{count} {name.replace('_', ' ')}" for name, count in counts.items())
    listed += ", no program named" if reference is None else ""
    console.print(f"[bold green]valid[/] {loaded.name}: {listed}")
    for warning in warnings:
        console.print(labelled("warning", "yellow", warning), soft_wrap=True)
