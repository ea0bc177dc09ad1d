"""`mrbt new`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from mrbt_mesh.cli.framework.declare import argument, option
from mrbt_mesh.formats.shipped import examples


def new(
    folder: Annotated[Path, argument("FOLDER", "A folder that does not exist yet.")],
    example: Annotated[
        str | None, option(f"Copy this example: {', '.join(examples())}.", "NAME")
    ] = None,
    btcpp: Annotated[
        Path | None,
        option("Robots that do this BehaviorTree.CPP tree (.xml) as a team.", "FILE"),
    ] = None,
    tree: Annotated[
        str | None, option("With --btcpp: the tree. Default: the main tree.", "ID")
    ] = None,
    models: Annotated[
        tuple[Path, ...],
        option("With --btcpp: file with models of nodes, or with SubTrees (.xml).", "FILE"),
    ] = (),
    trees: Annotated[
        tuple[Path, ...],
        option("With --btcpp: folder of tree files with SubTrees and models.", "DIR"),
    ] = (),
    as_action: Annotated[
        tuple[str, ...],
        option(
            "With --btcpp: a SubTree that is in no file, as an action of robot.py; '*': all.", "ID"
        ),
    ] = (),
    vda5050: Annotated[bool, option("Robots that are AGVs of VDA 5050.")] = False,
    ros2: Annotated[bool, option("For robots of ROS 2, with virtual ones to try it.")] = False,
) -> None:
    """Write a small mission and a robot of your own that run at once; or copy an example.

    Example: mrbt new my_team && mrbt up my_team/mission.yaml
    """
    import click

    from mrbt_mesh.cli.trees.lifting import known_besides
    from mrbt_mesh.cli.trees.new_from_tree import files_from_tree, print_units
    from mrbt_mesh.errors import InputError
    from mrbt_mesh.formats import template

    given = {"--example": example, "--btcpp": btcpp, "--vda5050": vda5050, "--ros2": ros2}
    chosen = [name for name, value in given.items() if value not in (None, False)]
    if len(chosen) > 1:
        raise InputError(f"{' and '.join(chosen)}: choose one of them")
    besides = {"--tree": tree, "--models": models, "--trees": trees, "--as-action": as_action}
    if btcpp is None and any(besides.values()):
        names = " and ".join(name for name, value in besides.items() if value)
        raise InputError(f"{names}: only with --btcpp")
    name, lifted = template.mission_name(folder.resolve().name), None
    try:
        if example is not None:
            files = template.example_files(example)
        elif btcpp is not None:
            others = known_besides(models, trees)
            files, lifted = files_from_tree(folder, btcpp, tree, others, as_action)
        else:
            files = template.template_files(name, "vda5050" if vda5050 else "ros2" if ros2 else "")
        written = template.write_files(folder, files)
    except OSError as error:
        raise InputError(f"{folder}: cannot be written: {error.strerror}") from None
    for path in written:
        click.echo(f"wrote {path}")
    if lifted is not None:
        print_units(lifted)
    if ros2:
        click.echo(f"\nfirst, with ROS 2: python3 {folder / 'virtual_robots.py'} A1 A2 A3")
        click.echo(f"then, beside it: mrbt up {folder / 'mission.yaml'}")
        return
    click.echo(f"\nnow: mrbt up {folder / 'mission.yaml'}")
