"""Jobs of a running team: to submit one, to look at them, to change one."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Awaitable, Callable, Sequence
from dataclasses import asdict
from datetime import datetime, time, timedelta
from typing import TYPE_CHECKING, NoReturn

import click

from mrbt_mesh.cli.command import FAILURE, SUCCESS, MrbtCommand, fail
from mrbt_mesh.cli.options import json_option
from mrbt_mesh.cli.team_options import TeamOptions, team_options
from mrbt_mesh.errors import InputError

if TYPE_CHECKING:
    from mrbt_mesh.core.observer.job_rows import JobRow
    from mrbt_mesh.runtime.team_client import TeamClient

FOLLOW_S = 0.5
# Of times from now: a year.
MAX_SECONDS = 366 * 86_400
ENDED = ("succeeded", "failed", "cancelled", "expired")


def job_time(
    _: click.Context, option: click.Parameter, text: str | None
) -> datetime | timedelta | None:
    """A time of the local time zone or another one, or seconds from now."""
    if text is None:
        return None
    with contextlib.suppress(ValueError):
        if text.startswith("+") and 0 <= (seconds := float(text)) <= MAX_SECONDS:
            return timedelta(seconds=seconds)
    with contextlib.suppress(ValueError, OverflowError):
        return datetime.fromisoformat(text).astimezone()
    with contextlib.suppress(ValueError):
        return datetime.combine(datetime.now().date(), time.fromisoformat(text)).astimezone()
    expected = "+600 (seconds from now), 14:30 (today), 2026-05-04T14:30 or 2026-05-04T14:30+02:00"
    raise click.BadParameter(f"{text!r} is no time: {expected}", param=option)


@click.command(cls=MrbtCommand)
@click.argument("kind", metavar="TYPE", help="A type of jobs of the mission.")
@click.argument("arguments", metavar="[ARGUMENT]...", nargs=-1, help="Its arguments, in order.")
@click.option("--id", "name", metavar="ID", help="Its id; the same id again is the same job.")
@click.option("--priority", type=int, metavar="N", help="Larger goes first.")
@click.option(
    "--not-before",
    metavar="TIME",
    callback=job_time,
    help="It does not begin before this time (ISO 8601) or +SECONDS from now.",
)
@click.option(
    "--deadline",
    metavar="TIME",
    callback=job_time,
    help="When it expires, likewise (default: as its type says).",
)
@click.option(
    "--safe",
    type=click.IntRange(1),
    metavar="N",
    help="Answer once this many journals hold it (default: a majority).",
)
@click.option("--wait", is_flag=True, help="Wait for its end; status 1 unless it succeeds.")
@team_options
@json_option
def submit(
    kind: str,
    arguments: Sequence[str],
    name: str | None,
    priority: int | None,
    not_before: datetime | timedelta | None,
    deadline: datetime | timedelta | None,
    safe: int | None,
    wait: bool,
    team: TeamOptions,
    as_json: bool,
) -> None:
    """Hand a job to a running team.

    \b
    Example: mrbt submit deliver shelf_2 dock_1 --priority 5 --wait
             mrbt submit inspect shelf_5 --not-before 14:30 --deadline +7200
    """

    async def act(client: TeamClient) -> int:
        job = await client.submit(
            kind,
            *arguments,
            job_id=name or "",
            priority=priority,
            not_before=not_before,
            deadline=deadline,
            safe=safe,
        )
        if not wait:
            click.echo(json.dumps({"id": job.id}) if as_json else job.id)
            return SUCCESS
        end = await job.done()
        click.echo(json.dumps(asdict(end)) if as_json else _line(end))
        return SUCCESS if end.state == "succeeded" else FAILURE

    _with_client(team, act)


@click.command(cls=MrbtCommand)
@click.option("--follow", is_flag=True, help="Print changes until Ctrl-C.")
@click.option("--open", "only_open", is_flag=True, help="Leave out those that have ended.")
@team_options
@json_option
def jobs(follow: bool, only_open: bool, team: TeamOptions, as_json: bool) -> None:
    """List the jobs of a running team: their states, what they wait for, and who does them.

    Example: mrbt jobs --follow
    """

    async def act(client: TeamClient) -> int:
        import anyio

        seen: dict[str, JobRow] = {}
        while True:
            rows = [row for row in client.jobs if not (only_open and row.state in ENDED)]
            new = [row for row in rows if seen.get(row.id) != row]
            if as_json and not follow:
                click.echo(json.dumps([asdict(row) for row in rows], indent=2))
            elif not rows and not follow:
                click.echo("no jobs")
            for row in () if as_json and not follow else new:
                click.echo(json.dumps(asdict(row)) if as_json else _line(row))
            if not follow:
                return SUCCESS
            seen = {row.id: row for row in rows}
            await anyio.sleep(FOLLOW_S)

    _with_client(team, act)


@click.command(cls=MrbtCommand)
@click.argument(
    "change",
    metavar="CHANGE",
    type=click.Choice(("cancel", "hold", "release", "priority")),
    help="cancel, hold, release or priority.",
)
@click.argument("name", metavar="ID", help="The id of a job.")
@click.argument("number", metavar="[N]", type=int, required=False, help="The new priority.")
@click.option("--now", is_flag=True, help="hold: what runs of it is cancelled.")
@team_options
@json_option
def job(
    change: str, name: str, number: int | None, now: bool, team: TeamOptions, as_json: bool
) -> None:
    """Cancel a job, hold it until it is released, or give it another priority.

    No further step of a job that is held begins; what runs goes on, unless --now is given.

    \b
    Example: mrbt job cancel morning-1
             mrbt job hold morning-1 --now
             mrbt job priority morning-1 10
    """
    if (change == "priority") is not (number is not None):
        raise InputError("`priority` takes a number, e.g. mrbt job priority morning-1 10")

    if now and change != "hold":
        raise InputError("--now is for `hold`")

    async def act(client: TeamClient) -> int:
        state = await client.change(name, "hold_now" if now else change, number)
        why = f"; {state['reason']}" if state.get("reason") else ""
        click.echo(json.dumps(state) if as_json else f"{name}: {state['state']}{why}")
        return SUCCESS

    _with_client(team, act)


def _line(row: JobRow) -> str:
    inside = ",".join(row.arguments.values())
    what = f"{row.type}({inside})" if inside else row.type
    who = f" {', '.join(row.robots)}" if row.robots else ""
    why = f" ({row.why})" if row.why else ""
    priority = f" priority {row.priority}" if row.priority else ""
    return f"{row.id:<28} {row.state:<10} {what}{who}{why}{priority}"


def _with_client(team: TeamOptions, act: Callable[[TeamClient], Awaitable[int]]) -> NoReturn:
    """Attach to a team that takes jobs, act, and end the process with the status of `act`."""
    import anyio

    from mrbt_mesh.runtime.team_client import client_of

    address = team.find_running()

    async def attach() -> int:
        async with client_of(address) as client:
            return await act(client)

    try:
        status = anyio.run(attach)
    except TimeoutError as error:
        fail(str(error), FAILURE)
    except KeyboardInterrupt:
        status = SUCCESS
    raise SystemExit(status)
