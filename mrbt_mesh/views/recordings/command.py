"""`mrbt recording`: recorded runs."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import click

from mrbt_mesh.cli.command import (
    EXIT_OF_RESULT,
    FAILURE,
    PATH,
    PORT,
    SUCCESS,
    CommandGroup,
    FiniteNumber,
    refuse,
)
from mrbt_mesh.cli.options import (
    FAULTS,
    fault_options,
    json_option,
    program_option,
    seed_option,
    virtual_timeout_option,
)
from mrbt_mesh.errors import require

file_argument = click.argument("file", metavar="FILE.mcap", type=PATH, help="A recording.")
keys_option = click.option(
    "--keys",
    type=PATH,
    metavar="DIR",
    help="Folder with the team's manifest. Default: that of the run directory.",
)
GAPS = ("unsigned", "robot", "observer", "named", "end", "summary", "commands")
WHAT_IF = tuple(name for name in FAULTS if name != "performance")


@click.group(cls=CommandGroup)
def recording() -> None:
    """Replay, verify and report on recorded runs.

    Example: mrbt recording verify
    """


@recording.command()
@file_argument
@click.option(
    "--at", type=FiniteNumber(0), metavar="SECONDS", help="Begin there; --json: the state then."
)
@click.option("--speed", type=FiniteNumber(0.01, 1000), default=1.0, help="Times as fast.")
@click.option("--web", is_flag=True, help="Show it in the browser, until Ctrl-C.")
@click.option("--host", default="127.0.0.1", metavar="IP", help="Address of the page.")
@click.option("--port", type=PORT, metavar="PORT", default=0, help="Port of the page; 0: any.")
@json_option
def replay(
    file: Path,
    at: float | None,
    speed: float,
    web: bool,
    host: str,
    port: int,
    as_json: bool,
) -> None:
    """Show a recorded run again, at any speed, forwards and back.

    In the terminal, space pauses, comma and full stop go 5 s back or on, < and > change the speed,
    q quits; ? lists all keys. Without a terminal it prints the events. With --json, the whole
    state at a time, by default at the end; with --web too, the page's address.

    \b
    Example: mrbt recording replay run.mcap --web
             mrbt recording replay recordings/A1.mcap --at 12.5 --json
    """
    import anyio

    from mrbt_mesh.cli.terminal import print_json
    from mrbt_mesh.recording.player import Player
    from mrbt_mesh.recording.reader import open_recording
    from mrbt_mesh.views.recordings.showing import (
        serve,
        show_lines,
        state_data,
        time_of,
    )

    if web:
        require("the page", "web", "starlette", "uvicorn")
    else:
        refuse("of the page: give --web as well", "--port", "--host")
    player = Player(open_recording(file))
    if web:
        anyio.run(serve, player, at or 0.0, speed, host, port, as_json)
        raise SystemExit(SUCCESS)
    if as_json:
        refuse("--json prints one state, without delay", "--speed")
        print_json(state_data(player, at))
    elif sys.stdin.isatty() and sys.stdout.isatty():
        from mrbt_mesh.views.replay.shown_recording import ShownRecording
        from mrbt_mesh.views.terminal.app import ReplayTop

        top = ReplayTop(ShownRecording(player, time_of(player, at or 0.0), speed))
        top.run()
        if top.problem is not None:
            raise top.problem
    else:
        show_lines(player, at or 0.0)


@recording.command()
@click.argument(
    "paths",
    metavar="[FILE.mcap|RUN_DIR]...",
    type=PATH,
    nargs=-1,
    help="Recordings, or run directories. Default: the run of the team that runs, or the newest.",
)
@keys_option
@click.option(
    "--accept",
    type=click.Choice(GAPS),
    multiple=True,
    help="What need not be proved. May be repeated.",
)
@json_option
def verify(
    paths: tuple[Path, ...], keys: Path | None, accept: tuple[str, ...], as_json: bool
) -> None:
    """Verify a run from its recordings: what is proved, what is not, what was falsified.

    Every plan is made again from the recorded facts; each robot must have followed its plans; every
    takeover must have a cause; the recordings of several robots must agree; and each must be
    signed, there and whole. Without keys everything can be forged: --accept unsigned then checks
    that the recordings agree.

    Exit status: 0 all is proved or accepted, 1 something is not, 2 bad input.

    \b
    Example: mrbt recording verify RUN_DIR
             mrbt recording verify RUN_DIR --keys my_keys
             mrbt recording verify simulated --accept unsigned
    """
    from mrbt_mesh.cli.terminal import console, print_json
    from mrbt_mesh.views.recordings.files import verified
    from mrbt_mesh.views.recordings.render import render_verdict

    found = verified(paths, keys)
    holds = found.holds(accept)
    if as_json:
        print_json({"verified": holds, "accepted": sorted(accept), **found.to_json()})
    else:
        console.print(render_verdict(found, accept))
    raise SystemExit(SUCCESS if holds else FAILURE)


@recording.command()
@click.argument(
    "path",
    metavar="[FILE.mcap|RUN_DIR]",
    type=PATH,
    required=False,
    help="A recording, or a run directory. Default: the run of the team that runs, or the newest.",
)
@click.option(
    "--output",
    "-o",
    type=PATH,
    default="report.html",
    metavar="FILE.html",
    help="Write the page to this file.",
)
@keys_option
@json_option
def report(path: Path | None, output: Path, keys: Path | None, as_json: bool) -> None:
    """Report on a run: its result, who worked and waited when, jobs, faults and takeovers, what
    operators commanded, and what `mrbt recording verify` finds.

    It writes one HTML page that needs nothing else, and that any browser prints. With --json it
    prints the figures instead.

    \b
    Example: mrbt recording report RUN_DIR -o report.html
             mrbt recording report run.mcap --keys RUN_DIR/keys
    """
    from mrbt_mesh.cli.terminal import check_outputs, print_json, write_file
    from mrbt_mesh.runtime.known_runs import look_up_run
    from mrbt_mesh.views.recordings.files import verified
    from mrbt_mesh.views.report.page import check_page, report_html
    from mrbt_mesh.views.report.sources import read_report

    if not as_json:
        check_outputs(None, {"-o": output})
        check_page(output)

    chosen = path or look_up_run(None, "RUN_DIR").path
    found = read_report(chosen, lambda path: verified((path,), keys))
    if as_json:
        print_json(found.to_json())
    else:
        write_file(output, report_html(found))
        click.echo(f"wrote {output}")


@recording.command("what-if")
@file_argument
@click.option(
    "--at",
    type=FiniteNumber(0),
    required=True,
    metavar="SECONDS",
    help="The moment.",
)
@fault_options(*WHAT_IF)
@click.option(
    "--without-recorded-faults",
    is_flag=True,
    help="What failed after --at, died or joined, and operators' commands, do not happen again.",
)
@program_option
@seed_option
@virtual_timeout_option
@json_option
def what_if(
    file: Path,
    at: float,
    without_recorded_faults: bool,
    program: str | None,
    seed: int,
    timeout: float,
    as_json: bool,
    **faults: Any,
) -> None:
    """Continue a recorded run from a moment in the simulator, with faults that did not happen.

    Recorded faults and commands after --at happen again, and recorded work takes as long: with
    nothing changed, the run goes on as it did. Faults without @SECONDS happen at --at. All times
    count from the begin of the recording.

    Exit status: 0 the mission would have succeeded, 1 failed, 2 bad input, 3 not be finished.

    \b
    Example: mrbt recording what-if run.mcap --at 12 --kill B1
             mrbt recording what-if run.mcap --at 12 --fault B1:replace_hw --restore B1@20
             mrbt recording what-if run.mcap --at 12 --without-recorded-faults
    """
    from mrbt_mesh.cli.terminal import console, print_json
    from mrbt_mesh.views.recordings.continuing import continued
    from mrbt_mesh.views.recordings.render import render_what_if

    data = continued(file, at, faults, without_recorded_faults, program, seed, timeout)
    if as_json:
        print_json(data)
    else:
        console.print(render_what_if(data))
    raise SystemExit(EXIT_OF_RESULT[data["what_if"]["result"]])
