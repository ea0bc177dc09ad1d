"""`mrbt lift`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from mrbt_mesh.cli.framework.declare import argument, option
from mrbt_mesh.cli.options import JsonOption


def lift(
    file: Annotated[Path, argument("FILE", "A single robot's tree, BehaviorTree.CPP XML.")],
    robots: Annotated[
        Path, option("Team file: robots, and what their local tasks do (.yaml).", "FILE")
    ],
    output: Annotated[
        Path | None,
        option("Write the mission there; without it only explain.", "FILE", short="-o"),
    ] = None,
    tree: Annotated[str | None, option("The tree. Default: the main tree.", "ID")] = None,
    models: Annotated[
        tuple[Path, ...], option("File with models of nodes, or with SubTrees (.xml).", "FILE")
    ] = (),
    trees: Annotated[
        tuple[Path, ...], option("Folder of tree files with SubTrees and models.", "DIR")
    ] = (),
    as_action: Annotated[
        tuple[str, ...],
        option("Take a SubTree that is in no file for an action; '*': all.", "ID"),
    ] = (),
    assume_independent: Annotated[
        tuple[str, ...],
        option("Children of this node (path or name) do not depend on one another.", "NODE"),
    ] = (),
    units: Annotated[
        str | None,
        option(
            "Keep together, on one robot, what shares a blackboard: found out (auto), or as a "
            "file says (.yaml).",
            "auto|FILE",
        ),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Make a team's mission out of the tree that drives one robot, and explain it.

    Every action becomes a global task for one robot (paper, section V-A). What may happen at the
    same time follows from what the actions declare to read, change and need; with no declarations
    nothing is put in parallel. With --units, parts that share a blackboard or other things of one
    robot become local tasks with trees of their own, in a file beside the mission.

    Example: mrbt lift examples/lift/repair.xml --robots examples/lift/team.yaml -o mission.yaml
    """
    import click

    from mrbt_mesh.cli.framework.terminal import console, note, print_json, write_file
    from mrbt_mesh.cli.trees.lifting import LiftRequest, lift_files
    from mrbt_mesh.cli.views.lift_view import lifted_data, render_lifted
    from mrbt_mesh.cli.views.units_view import render_units, units_data

    request = LiftRequest(
        file, robots, output, tree, models, trees, assume_independent, units, as_action
    )
    done = lift_files(request)
    for path, text in done.files.items():
        write_file(path, text)
    for remark in done.mission.notes:
        note(str(remark))
    if as_json:
        data = lifted_data(done.mission, output)
        print_json(data | (units_data(done.units) if done.units else {}))
        return
    if done.units is not None:
        console.print(render_units(done.units), soft_wrap=True)
    console.print(render_lifted(done.mission.lifted), soft_wrap=True)
    if output is not None:
        written = " and ".join(map(str, done.files))
        click.echo(f"written: {written} ({done.robots} robots); run it with: mrbt up {output}")
