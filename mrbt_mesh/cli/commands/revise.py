"""Give a running team another mission."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from mrbt_mesh.cli.command import FAILURE, PATH, SUCCESS, MrbtCommand, fail
from mrbt_mesh.cli.commands.operate import nobody, note_command, report, with_team
from mrbt_mesh.cli.options import json_option
from mrbt_mesh.cli.team_options import TeamOptions, team_options
from mrbt_mesh.errors import InputError

if TYPE_CHECKING:
    from mrbt_mesh.core.planning.revised import RevisionChanges
    from mrbt_mesh.runtime.watcher import Watcher


@click.command(cls=MrbtCommand)
@click.argument("new", metavar="[MISSION]", type=PATH, required=False, help="Mission file.")
@click.option("--dry-run", is_flag=True, help="Only say what would change.")
@click.option("--withdraw", is_flag=True, help="Take a proposal back that is not in force.")
@click.option("--force", is_flag=True, help="Also if work that is under way is cancelled.")
@click.option(
    "--timeout",
    "timeout_s",
    type=click.FloatRange(min=0, min_open=True),
    default=30.0,
    metavar="S",
    help="Withdraw it if it is not in force by then.",
)
@team_options
@json_option
def revise(
    new: Path | None,
    dry_run: bool,
    withdraw: bool,
    force: bool,
    timeout_s: float,
    team: TeamOptions,
    as_json: bool,
) -> None:
    """Give a running team another mission: other tasks, robots, types, places, or another tree.

    What is done of tasks that have not changed stays done, and robots go on with them. No robot
    begins anything between the proposal and the moment when all act by the new mission. --dry-run
    also says which faults the new mission survives with the robots that are alive.

    \b
    Example: mrbt revise new.yaml --dry-run
             mrbt revise new.yaml
    """
    from mrbt_mesh.formats.mission_file import load_mission
    from mrbt_mesh.runtime.team_revision import (
        RevisionRefusedError,
        next_revision,
        survived_losses,
        take_up,
        unserved,
    )

    if withdraw is (new is not None):
        raise InputError("give the new mission's file, or --withdraw")
    after = load_mission(new) if new is not None else None
    address = team.find_running()
    name = address.transport.team

    async def act(watcher: Watcher) -> int:
        if not watcher.observer.membership.members():
            fail(nobody(watcher), FAILURE)
        if after is None:
            return await _withdraw(watcher, name, as_json)
        revision, changes = next_revision(watcher, after)
        number, blocked = revision.revision_number, unserved(watcher, revision)
        survived = survived_losses(watcher, revision) if dry_run else {}
        if not as_json:
            click.echo("\n".join(lines(changes, blocked, survived)), err=not dry_run)
        if not dry_run:
            if changes.cancelled and not force:
                fail("work that is under way would be cancelled: wait for it, or --force", FAILURE)
            try:
                await take_up(
                    watcher, revision, force, timeout_s, lambda text: click.echo(text, err=True)
                )
            except RevisionRefusedError as error:
                fail(f"{name}: revision {number} is refused: {error}", FAILURE)
            if address.run_dir is not None:
                note_command(address.run_dir, "revise", f"revision {number} is in force")
        if as_json:
            told = {"team": name, "revision": number, "in_force": not dry_run, "blocked": blocked}
            told |= {"survives": survived} if dry_run else {}
            click.echo(json.dumps(told | changes.to_json(), indent=2))
        elif not dry_run:
            click.echo(f"{name}: revision {number} is in force")
        return SUCCESS

    with_team(address, act)


async def _withdraw(watcher: Watcher, team: str, as_json: bool) -> int:
    from mrbt_mesh.runtime.team_revision import withdraw

    facts = watcher.observer.facts
    pending = facts.revisions.pending(facts.declared.revision_number)
    if pending is None:
        fail(f"{team}: no revision is proposed", FAILURE)
    number = pending[1].revision_number
    answer = await withdraw(watcher, number)
    report(as_json, team, [*watcher.observer.membership.members()], "revise", answer)
    return SUCCESS


def lines(
    changes: RevisionChanges, blocked: Sequence[str], survived: Mapping[str, str]
) -> list[str]:
    """What a revision changes, and what its team then survives, for people."""
    from mrbt_mesh.core.bt.activation import parse_activation

    def subjects(activations: Sequence[str]) -> str:
        parts = map(parse_activation, activations)
        names = (each.subject + (f" of {each.job}" if each.job else "") for each in parts)
        return ", ".join(dict.fromkeys(names))

    def works(those: Sequence[tuple[str, str, str]]) -> str:
        return ", ".join(f"{robot}: {local_task} for {task}" for robot, task, local_task in those)

    found = {
        "stays done": subjects(changes.kept),
        "goes on": works(changes.going_on),
        "begins again": subjects(changes.begun_again),
        "is cancelled": works(changes.cancelled),
        "is forgotten": subjects(changes.dropped),
        "new tasks": ", ".join(changes.new_tasks),
        "new robots": ", ".join(changes.new_robots),
        "robots that leave": ", ".join(changes.removed_robots),
        "jobs without a type": ", ".join(changes.lost_jobs),
        "blocked": "; ".join(blocked),
    }
    shown = [f"{what + ':':<20} {text}" for what, text in found.items() if text]
    shown = shown or ["nothing is done or under way, and there are no new tasks or robots"]
    for kind, losses in survived.items():
        what = f"a job {kind} survives" if kind else "it survives"
        shown.append(f"{what + ':':<20} {losses}")
    return shown
