"""`mrbt replay`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from mrbt_mesh.cli.framework.declare import Given, argument, option
from mrbt_mesh.cli.options import JsonOption
from mrbt_mesh.cli.team.page_options import PANEL, PageAddress


def replay(
    file: Annotated[Path, argument("FILE.mcap", "A recording.")],
    *,
    given: Given,
    at: Annotated[
        float | None,
        option("Begin there, in seconds from the recording's begin.", "SECONDS", least=0),
    ] = None,
    speed: Annotated[float, option("So many times faster.", least=0.01, most=1000)] = 1.0,
    web: Annotated[bool, option("Show it in the browser.", panel=PANEL)] = False,
    page: PageAddress,
    as_json: JsonOption = False,
) -> None:
    """Show a recorded run again, at any speed, forwards and back.

    In the terminal: space pauses, the arrow keys left and right go 5 s back or forth, up and down
    change the speed, q ends. Without a terminal it prints what happened, line by line. With --json,
    the whole state at that time, by default at the end: facts, alive set, plan, statuses.

    In the browser with --web: the page of `mrbt web` with the whole run in its timeline, until
    Ctrl-C; with --json its address is the object's `page`.

    Example: mrbt replay run.mcap --web; mrbt replay recordings/A1.mcap --at 12.5 --json
    """
    from mrbt_mesh.cli.framework.terminal import console, print_json
    from mrbt_mesh.cli.recordings.replaying import show_lines, show_live, state_data
    from mrbt_mesh.recording.player import Player
    from mrbt_mesh.recording.reader import read_recording

    if not web:
        given.refuse(("--port", "--host"), "of the page: give --web as well")
    served = page.page() if web else None
    player = Player(read_recording(file))
    if served is not None:
        import anyio

        from mrbt_mesh.cli.framework.exits import end_process
        from mrbt_mesh.cli.recordings.showing import serve

        end_process(anyio.run(serve, player, at or 0.0, speed, served, as_json))
    elif as_json:
        given.refuse(["--speed"], "--json prints one state, without delay")
        print_json(state_data(player, at))
    elif console.is_terminal:
        show_live(player, at or 0.0, speed)
    else:
        show_lines(player, at or 0.0)
