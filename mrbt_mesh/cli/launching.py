"""A team of processes on this machine: started anew, or resumed from its journals."""

from __future__ import annotations

import contextlib
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import NoReturn

import anyio
import click

from mrbt_mesh.cli.command import BAD_INPUT, FAILURE, SUCCESS
from mrbt_mesh.cli.command_notes import note_command
from mrbt_mesh.cli.finished import has_ended, start_summary_writer
from mrbt_mesh.cli.guide import Guide
from mrbt_mesh.cli.jobs_left_behind import jobs_left_behind, open_jobs_text
from mrbt_mesh.cli.options import ShowOptions
from mrbt_mesh.cli.plugged import ChosenViews
from mrbt_mesh.cli.streams import lose_output_rather_than_end
from mrbt_mesh.cli.terminal import errors, labelled, note
from mrbt_mesh.cli.watching import Session, print_refusals
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.errors import InputError
from mrbt_mesh.formats.mission_file import compile_mission
from mrbt_mesh.recording.folder import observer_file
from mrbt_mesh.runtime.capacity import (
    BEAT_COST_S,
    ROBOT_MEMORY_MB,
    Machine,
    Overload,
    overload,
)
from mrbt_mesh.runtime.command_log import check_signer
from mrbt_mesh.runtime.known_runs import remember
from mrbt_mesh.runtime.launcher_lock import launched_from_here
from mrbt_mesh.runtime.observer_recording import RecordTo
from mrbt_mesh.runtime.run_dir import RunDir, RunInfo, state_dir
from mrbt_mesh.runtime.settings import START_S_PER_ROBOT
from mrbt_mesh.runtime.summary_signature import sign_summary
from mrbt_mesh.runtime.team import Team
from mrbt_mesh.runtime.team_address import address_of

# Enough for a slow machine to start a few robots.
UP_TIMEOUT_S = 60.0


def created(folder: Path | None, info: RunInfo, mission: Mission) -> RunDir:
    """Create the directory of a new run, by default in the state folder."""
    if folder is None:
        stamp = datetime.now().strftime("%Y%m%d-%H%M%S-%f")
        folder = state_dir() / "runs" / f"{mission.name}-{stamp}"
    found = RunDir.create(folder.resolve(), info, compile_mission(mission))
    try:
        remember(found)
    except InputError:
        found.discard()
        raise
    return found


def continued(folder: Path | None, info: RunInfo, mission: Mission) -> RunDir:
    """Prepare the directory of an earlier run to be continued, with its id and its team's name.

    Raises InputError if robots of it still run, if it is a run of another mission, or if its
    mission is over.
    """
    if folder is None:
        raise InputError("--continue needs the --run-dir of the run to continue")
    found = RunDir.of(folder.resolve())
    running = [robot for robot in found.robots() if found.process(robot) is not None]
    if running:
        raise InputError(f"{found.path}: {', '.join(running)} still run; see `mrbt watch`")
    if not found.is_run_of(mission):
        raise InputError(f"{found.path} is a run of another mission, or of another version of it")
    check_signer(found)
    before = found.info()
    if info.options.insecure != before.options.insecure:
        how = "without" if before.options.insecure else "with"
        raise InputError(
            f"{found.path} is a run {how} keys, and can only be continued so: --insecure"
        )
    has_ended(found)  # raises if its mission is over
    remember(found)
    options = replace(info.options, team=before.team, run=before.run)
    found.save(replace(info, options=options, robots=_in_good_standing(found, info)))
    left_behind = open_jobs_text(jobs_left_behind(found, mission))
    if left_behind:
        note(left_behind)
    found.remove_summary()
    note_command(found, "up --continue", "the team goes on")
    return found


def _in_good_standing(run_dir: RunDir, info: RunInfo) -> tuple[str, ...]:
    """Return the robots whose keys were not revoked, and note the revoked ones.

    Raises InputError if all keys were revoked.
    """
    if info.options.insecure:
        return info.robots
    from mrbt_mesh.runtime.key_folder import KeyFolder

    members = KeyFolder(run_dir.keys_path).manifest().members
    revoked = [r for r in info.robots if r in members and members[r].is_revoked]
    if not revoked:
        return info.robots
    names = ", ".join(revoked)
    if len(revoked) == len(info.robots):
        raise InputError(f"the keys of {names} were revoked: give them new ones (mrbt keys add)")
    note(f"not started, since the key was revoked: {names}")
    return tuple(robot for robot in info.robots if robot not in revoked)


def run_team(
    run_dir: RunDir,
    mission: Mission,
    show: ShowOptions | None,
    views: ChosenViews,
    guide: Guide | None = None,
) -> NoReturn:
    """Start the robots, watch them to the end, and end the process. With `show` None, detach
    instead.

    No robot ends because output cannot be written.
    """
    lose_output_rather_than_end()
    raise SystemExit(anyio.run(_run, run_dir, mission, show, views, guide))


async def _detached(team: Team) -> int:
    """Start a team and detach once all robots run. If one does not, stop them all."""
    run_dir, info = team.run_dir, team.info
    refused, problems = [], []
    try:
        await team.start_all()
        hanging = await team.until_up(max(UP_TIMEOUT_S, START_S_PER_ROBOT * len(info.robots)))
        refused, problems = team.refusals(), team.crashes()
        problems += [
            f"{robot} does not start; see {run_dir.output_path(robot)}" for robot in hanging
        ]
    except BaseException:
        with anyio.CancelScope(shield=True):
            await team.end()
        raise
    if refused or problems:
        await team.end()
        print_refusals(refused)
        for problem in problems:
            errors.print(labelled("error", "bold red", problem), soft_wrap=True)
        return BAD_INPUT if refused else FAILURE
    start_summary_writer(run_dir)
    click.echo(f"{info.team}: {len(info.robots)} robots run; see mrbt status")
    click.echo(f"run directory: {run_dir.path}")
    return SUCCESS


async def _run(
    run_dir: RunDir,
    mission: Mission,
    show: ShowOptions | None,
    views: ChosenViews,
    guide: Guide | None,
) -> int:
    info = run_dir.info()
    options, team = info.options, Team(run_dir, info, mission)
    here = Machine.here()
    too_many = overload(len(info.robots), options.beat_s, options.detection_s, here)
    if too_many is not None:
        text = labelled("warning", "yellow", overload_text(too_many))
        errors.print(text, soft_wrap=not errors.is_terminal)
    if info.metrics_ports:
        first, last = min(info.metrics_ports.values()), max(info.metrics_ports.values())
        ports = f"ports {first} to {last}" if first < last else f"port {first}"
        note(f"metrics on {ports} of 127.0.0.1, robot by robot: {run_dir.metrics_targets_path}")
    if show is None:
        return await _detached(team)
    with contextlib.ExitStack() as launched:
        launched.enter_context(launched_from_here(run_dir))

        async def end() -> None:
            with anyio.CancelScope(shield=True):
                await team.end()
            _sign_again(run_dir)
            launched.close()

        try:
            await team.start_all()
            path, beats = observer_file(run_dir.path), options.record_beats
            record = RecordTo(path, beats, options.speed, options.keep_bytes, has_summary=True)
            to = record if info.record else None
            address = address_of(run_dir)
            session = Session(
                address,
                team,
                show,
                views,
                record=to,
                overload=too_many,
                guide=guide,
                end_team=end if guide is None else None,
            )
            return await session.run()
        finally:
            await end()


def _sign_again(run_dir: RunDir) -> None:
    """Sign the summary once the robots have ended, so that it names their last records.

    It was signed when it was written, in case that this process would not get here.
    """
    try:
        if run_dir.summary() is not None:
            sign_summary(run_dir)
    except InputError as error:
        errors.print(str(error), soft_wrap=True)


def overload_text(found: Overload) -> str:
    """Return the warning: the figures of this machine, and the remedies."""
    remedies = [f"at most {found.carried} robots (--robots)"]
    if found.enough_beat_s is not None:
        beat, detection = f"--beat {found.enough_beat_s:g}", f"{found.enough_detection_s:g}"
        remedies.append(f"slower heartbeats ({beat} --detection {detection})")
    remedies.append("robots on several machines (mrbt agent)")
    cores = f"{found.cores} core" + "s" * (found.cores > 1)
    return (
        f"{found.robots} robots are too many for this machine: about {found.carried} fit {cores} "
        f"and {found.free_memory_mb:,} MB of free memory. A robot takes {1e3 * BEAT_COST_S:g} ms "
        f"of a core per heartbeat (every {found.beat_s:g} s) and {ROBOT_MEMORY_MB} MB without its "
        "program. The team starts anyway, slowly, and reacts late. Better: "
        f"{', '.join(remedies[:-1])}, or {remedies[-1]}."
    )
