"""Jobs of a running team: submit, list and change them."""

from __future__ import annotations

import json
import sys
from collections.abc import Awaitable, Callable, Mapping, Sequence
from dataclasses import asdict
from datetime import datetime, timedelta
from typing import TYPE_CHECKING, NoReturn

import click

from mrbt_mesh.cli.command import FAILURE, SUCCESS, MrbtCommand, NumbersCommand, fail, refuse
from mrbt_mesh.cli.command_notes import note_command
from mrbt_mesh.cli.job_times import job_time, understood
from mrbt_mesh.cli.job_words import arguments_in
from mrbt_mesh.cli.options import json_option
from mrbt_mesh.cli.team_options import TeamOptions, team_options
from mrbt_mesh.errors import InputError

if TYPE_CHECKING:
    from mrbt_mesh.observer.job_rows import JobRow
    from mrbt_mesh.runtime.team_client import TeamClient

FOLLOW_S = 0.5
ENDED = ("succeeded", "failed", "cancelled", "expired")


@click.command(cls=NumbersCommand)
@click.argument("kind", metavar="[TYPE]", required=False, help="A type of jobs of the mission.")
@click.argument(
    "words",
    metavar="[ARGUMENT]...",
    nargs=-1,
    help="Its arguments: all in order, or all as NAME=VALUE.",
)
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
@click.option(
    "--stdin",
    "from_stdin",
    is_flag=True,
    help="Many jobs: a JSON object per line of standard input, with type, arguments (a list, or an "
    "object by parameter), id, priority, not_before, deadline, safe.",
)
@team_options
@json_option
def submit(
    kind: str | None,
    words: Sequence[str],
    name: str | None,
    priority: int | None,
    not_before: datetime | timedelta | None,
    deadline: datetime | timedelta | None,
    safe: int | None,
    wait: bool,
    from_stdin: bool,
    team: TeamOptions,
    as_json: bool,
) -> None:
    """Hand a job to a running team, or many with --stdin.

    Those of --stdin are all checked first: if a line is wrong, none is submitted (status 2). Then
    there is a line for each, in the same order; status 1 if the team has refused one.

    \b
    Example: mrbt submit deliver shelf_2 dock_1 3 --priority 5 --wait
             mrbt submit deliver shelf=shelf_2 dock=dock_1 boxes=3
             mrbt submit inspect shelf_5 --not-before 14:30 --deadline +7200
             mrbt submit --stdin < jobs.jsonl
    """
    if from_stdin:
        alone = ("TYPE", "ARGUMENT", "--id", "--priority", "--not-before", "--deadline", "--wait")
        refuse("with --stdin, lines say which jobs; see `mrbt jobs` for their ends", *alone)
        _submit_lines(team, safe, as_json)
    if kind is None:
        raise InputError("Missing argument 'TYPE': a type of jobs, or --stdin for many jobs")
    from mrbt_mesh.runtime.team_client import new_job_id

    arguments, job_id = arguments_in(words), name or new_job_id()
    interrupted = f"interrupted: `mrbt jobs` shows whether {job_id} was taken"

    async def act(client: TeamClient) -> int:
        nonlocal interrupted
        job = await client.submit(
            kind,
            arguments=arguments,
            job_id=job_id,
            priority=priority,
            not_before=not_before,
            deadline=deadline,
            safe=safe,
        )
        times = understood(not_before=not_before, deadline=deadline)
        if times and not as_json:
            click.echo(_in_utc(times), err=True)
        if not wait:
            click.echo(json.dumps({"id": job.id} | times) if as_json else job.id)
            return SUCCESS
        interrupted = f"interrupted: {job.id} goes on (`mrbt job cancel {job.id}` ends it)"
        click.echo(f"{job.id} is submitted", err=True)
        end = await job.done()
        click.echo(json.dumps(asdict(end)) if as_json else _line(end))
        return SUCCESS if end.state == "succeeded" else FAILURE

    _with_client(team, act, lambda: interrupted)


def _in_utc(times: Mapping[str, str]) -> str:
    listed = ", ".join(f"{name} {text}" for name, text in times.items())
    return f"in UTC: {listed}"


def _submit_lines(team: TeamOptions, safe: int | None, as_json: bool) -> NoReturn:
    """Submit the jobs on standard input, and end the process."""
    from mrbt_mesh.cli.job_lines import Problems, Result, checked, hand_in, read_lines

    problems = Problems()
    lines = read_lines(sys.stdin.buffer, problems)
    shown = 0

    def show(result: Result) -> None:
        nonlocal shown
        shown += 1
        click.echo(json.dumps(result.data()) if as_json else result.text())

    async def act(client: TeamClient) -> int:
        jobs = checked(client, lines, safe, problems)
        problems.check()
        for each in jobs:
            times = understood(not_before=each.not_before, deadline=each.deadline)
            notes = [*each.notes, *([_in_utc(times)] if times and not as_json else [])]
            for text in notes:
                click.echo(f"line {each.number}: {text}", err=True)
        return SUCCESS if await hand_in(client, jobs, show) else FAILURE

    def interrupted() -> str:
        return (
            f"interrupted after {shown} of {len(lines)} jobs; `mrbt jobs` shows which others were "
            "taken (lines with an id can be given again)"
        )

    _with_client(team, act, interrupted)


@click.command(cls=MrbtCommand)
@click.option("--follow", is_flag=True, help="Print changes until Ctrl-C.")
@click.option("--open", "only_open", is_flag=True, help="Leave out those that have ended.")
@team_options
@json_option
def jobs(follow: bool, only_open: bool, team: TeamOptions, as_json: bool) -> None:
    """List the jobs of a team: their states, what they wait for, and who does them.

    Of one that does not run any more: those that its robots' journals hold.

    Example: mrbt jobs --follow
    """

    from mrbt_mesh.cli.finished import summary_of_finished
    from mrbt_mesh.cli.jobs_left_behind import jobs_left_behind
    from mrbt_mesh.formats.mission_file import load_mission

    found = team.run_directory()
    if found is not None and summary_of_finished(found) is not None:
        click.echo("the run is over; its journals hold:", err=True)
        _print_jobs(jobs_left_behind(found, load_mission(found.mission_path)), only_open, as_json)
        return

    async def act(client: TeamClient) -> int:
        import anyio

        seen: dict[str, JobRow] = {}
        while True:
            if not follow:
                _print_jobs(client.jobs, only_open, as_json)
                return SUCCESS
            rows = _wanted(client.jobs, only_open)
            for row in [row for row in rows if seen.get(row.id) != row]:
                click.echo(json.dumps(asdict(row)) if as_json else _line(row))
            seen = {row.id: row for row in rows}
            await anyio.sleep(FOLLOW_S)

    _with_client(team, act)


@click.command(cls=NumbersCommand)
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
        run_dir = team.run_directory()
        if run_dir is not None:
            given = {"hold": " now" * now, "priority": f" {number}"}.get(change, "")
            note_command(run_dir, "job", f"{change} {name}{given}")
        why = f"; {state['reason']}" if state.get("reason") else ""
        click.echo(json.dumps(state) if as_json else f"{name}: {state['state']}{why}")
        return SUCCESS

    _with_client(team, act)


def _wanted(rows: Sequence[JobRow], only_open: bool) -> list[JobRow]:
    return [row for row in rows if not (only_open and row.state in ENDED)]


def _print_jobs(rows: Sequence[JobRow], only_open: bool, as_json: bool) -> None:
    wanted = _wanted(rows, only_open)
    if as_json:
        click.echo(json.dumps([asdict(row) for row in wanted], indent=2))
    elif not wanted:
        click.echo("no jobs")
    else:
        for row in wanted:
            click.echo(_line(row))


def _line(row: JobRow) -> str:
    inside = ",".join(map(str, row.arguments.values()))
    what = f"{row.type}({inside})" if inside else row.type
    who = f" {', '.join(row.robots)}" if row.robots else ""
    why = f" ({row.why})" if row.why else ""
    priority = f" priority {row.priority}" if row.priority else ""
    return f"{row.id:<28} {row.state:<10} {what}{who}{why}{priority}"


def _with_client(
    team: TeamOptions,
    act: Callable[[TeamClient], Awaitable[int]],
    interrupted: Callable[[], str] | None = None,
) -> NoReturn:
    """Attach to a running team, act, and end the process with the status of `act`.

    After Ctrl-C the status is SUCCESS without `interrupted`, else FAILURE with its message.
    """
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
        if interrupted is not None:
            fail(interrupted(), FAILURE)
    raise SystemExit(status)
