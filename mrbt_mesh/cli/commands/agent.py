"""`mrbt agent`: named here for the list of commands.

`cli.main` hands it over before anything of the command line is imported, to keep robots small.
"""

from __future__ import annotations

import click


@click.command(add_help_option=False, context_settings={"ignore_unknown_options": True})
@click.argument("arguments", nargs=-1, type=click.UNPROCESSED)
def agent(arguments: tuple[str, ...]) -> None:
    """Run one robot, anywhere on the network."""
    from mrbt_mesh.runtime.agent_main import main

    main(arguments)
