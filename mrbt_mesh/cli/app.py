"""The typer application: every command in one place."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated

import typer

from mrbt_mesh import __version__
from mrbt_mesh.cli import offline, team
from mrbt_mesh.cli.analyze import analyze
from mrbt_mesh.cli.demo import demo
from mrbt_mesh.cli.drill import drill
from mrbt_mesh.cli.lift import lift
from mrbt_mesh.cli.sim import sim
from mrbt_mesh.cli.simulate import simulate
from mrbt_mesh.cli.tree import tree_app
from mrbt_mesh.cli.up import up, watch

app = typer.Typer(
    name="mrbt",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    help="Teams of robots on one behavior tree, with no coordinator.",
    epilog="Example: mrbt up examples/vehicle_repair/mission.yaml",
)


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"mrbt-mesh {__version__}")
        raise typer.Exit


@app.callback()
def _root(
    version: Annotated[
        bool,
        typer.Option("--version", callback=_version, is_eager=True, help="Print the version."),
    ] = False,
) -> None:
    pass


def _agent() -> None:
    """Run one robot, anywhere on the network; see `mrbt agent --help`.

    Example: mrbt agent --mission MISSION --robot A1
    """


PANELS: dict[str, tuple[Callable[..., None], ...]] = {
    "Run a team": (demo, up, watch, team.status, team.join),
    "Act on a running team": (
        team.kill,
        team.freeze,
        team.thaw,
        team.fault,
        team.restore,
        team.leave,
        team.pause,
        team.resume,
        team.abort,
        team.decide,
    ),
    "Without a network": (
        offline.validate,
        offline.plan,
        offline.assign,
        analyze,
        sim,
        simulate,
        lift,
        offline.new,
        offline.key,
    ),
    "Prove it": (drill,),
}
for _panel, _functions in PANELS.items():
    for _function in _functions:
        app.command(rich_help_panel=_panel)(_function)
app.add_typer(tree_app, name="tree", rich_help_panel="Without a network")
# Listed for the help only: `main` hands `mrbt agent` over before typer is imported.
app.command("agent", rich_help_panel="Run a team")(_agent)
