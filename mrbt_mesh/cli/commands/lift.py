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
    assume_independent: Annotated[
        tuple[str, ...],
        option("Children of this node (path or name) do not depend on one another.", "NODE"),
    ] = (),
    as_json: JsonOption = False,
) -> None:
    """Make a team's mission out of the tree that drives one robot, and explain it.

    Every action becomes a global task for one robot (paper, section V-A). What may happen at the
    same time follows from what the actions declare to read, change and need; with no declarations
    nothing is put in parallel.

    Example: mrbt lift examples/lift/repair.xml --robots examples/lift/team.yaml -o mission.yaml
    """
    import click

    from mrbt_mesh.analysis.lift_mission import lift_mission
    from mrbt_mesh.cli.framework.terminal import console, note, print_json, write_file
    from mrbt_mesh.cli.trees.lifting import (
        checked_text,
        known_besides,
        library_and_tree,
        mission_name,
    )
    from mrbt_mesh.cli.views.lift_view import lifted_data, render_lifted
    from mrbt_mesh.formats.team_file import load_team

    library, name = library_and_tree(file, tree, known_besides(models, trees))
    team = load_team(robots)
    found = lift_mission(library, name, team, list(assume_independent), mission_name(file))
    text = checked_text(found, name, file, robots, output)
    if output is not None:
        write_file(output, text)
    for remark in found.notes:
        note(str(remark))
    if as_json:
        print_json(lifted_data(found, output))
        return
    console.print(render_lifted(found.lifted), soft_wrap=True)
    if output is not None:
        count = len(team.model.robots)
        click.echo(f"written: {output} ({count} robots); run it with: mrbt up {output}")
