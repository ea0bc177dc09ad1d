"""Give a running team another mission."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from mrbt_mesh.cli.command import FAILURE, PATH, SUCCESS, MrbtCommand, fail
from mrbt_mesh.cli.command_notes import note_command
from mrbt_mesh.cli.commands.operate import nobody, report, with_team
from mrbt_mesh.cli.options import json_option
from mrbt_mesh.cli.team_options import TeamOptions, team_options
from mrbt_mesh.errors import InputError

if TYPE_CHECKING:
    from mrbt_mesh.core.mission.mission import Mission
    from mrbt_mesh.features.revisions.changes import RevisionChanges
    from mrbt_mesh.runtime.team_revision import Consent
    from mrbt_mesh.runtime.watcher import Watcher


@click.command(cls=MrbtCommand)
@click.argument("new", metavar="[MISSION]", type=PATH, required=False, help="Mission file.")
@click.option("--dry-run", is_flag=True, help="Only say what would change.")
@click.option("--withdraw", is_flag=True, help="Take a proposal back that is not in force.")
@click.option(
    "--force", is_flag=True, help="Also if it cancels work, robots leave, or cannot do it."
)
@click.option(
    "--repeat-exclusive",
    is_flag=True,
    help="Also if exclusive tasks that were begun are begun again.",
)
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
    repeat_exclusive: bool,
    timeout_s: float,
    team: TeamOptions,
    as_json: bool,
) -> None:
    """Give a running team another mission: other tasks, robots, types, places, or another tree.

    What is done of tasks that have not changed stays done, and robots go on with them. No robot
    begins anything between the proposal and the moment when all act by the new mission.

    A revision that would cancel work, of a mission of another name, by which robots that are alive
    would leave, or that they cannot do, is refused without --force. One that would begin
    `exclusive` tasks again is refused without --repeat-exclusive.

    --dry-run says what would be kept, begun again and cancelled, why the revision would be refused
    (its exit status is then 1), and which faults the new mission survives with the robots that are
    alive.

    \b
    Example: mrbt revise new.yaml --dry-run
             mrbt revise new.yaml
    """
    from mrbt_mesh.formats.mission_file import load_mission
    from mrbt_mesh.runtime.program_loader import program_file
    from mrbt_mesh.runtime.team_revision import Consent

    if withdraw is (new is not None):
        raise InputError("give the new mission's file, or --withdraw")
    after = load_mission(new) if new is not None else None
    address, consent = team.find_running(), Consent(force, repeat_exclusive)
    # A robot that joins later loads it. Robots on other machines have files of their own.
    if after is not None and after.program is not None and address.run_dir is not None:
        program_file(after.program)

    async def act(watcher: Watcher) -> int:
        if not watcher.observer.membership.members():
            fail(nobody(watcher), FAILURE)
        name = address.transport.team
        if after is None:
            return await _withdraw(watcher, name, as_json)
        if dry_run:
            return await _dry_run(watcher, name, after, consent, as_json)
        number = await _revise(watcher, name, after, consent, timeout_s, as_json)
        if address.run_dir is not None:
            note_command(address.run_dir, "revise", f"revision {number} is in force")
        return SUCCESS

    with_team(address, act)


async def _dry_run(
    watcher: Watcher, team: str, after: Mission, consent: Consent, as_json: bool
) -> int:
    """Print what would change, and whether the team would refuse it. Returns the exit status."""
    from mrbt_mesh.runtime.team_revision import next_revision, refusals, survived_losses, unserved

    revision, changes = next_revision(watcher, after)
    blocked, survived = unserved(watcher, revision), survived_losses(watcher, revision)
    reasons = await refusals(watcher, revision, changes, consent)
    if as_json:
        told = {"team": team, "revision": revision.number, "in_force": False}
        told |= {"blocked": blocked, "survives": survived, "refused": reasons}
        click.echo(json.dumps(told | changes.to_json(), indent=2))
    else:
        shown = lines(changes, blocked, survived)
        shown += [f"{'would be refused:':<20} {each}" for each in reasons]
        click.echo("\n".join(shown))
    return FAILURE if reasons else SUCCESS


async def _revise(
    watcher: Watcher,
    team: str,
    after: Mission,
    consent: Consent,
    timeout_s: float,
    as_json: bool,
) -> int:
    """Have the team adopt the revision. Returns its number."""
    from mrbt_mesh.runtime.team_revision import (
        RevisionRefusedError,
        next_revision,
        refusals,
        take_up,
        unserved,
    )

    revision, changes = next_revision(watcher, after)
    number, blocked = revision.number, unserved(watcher, revision)
    if not as_json:
        click.echo("\n".join(lines(changes, blocked, {})), err=True)
    reasons = await refusals(watcher, revision, changes, consent)
    if reasons:
        fail("\n".join(f"{team}: this revision is refused: {each}" for each in reasons), FAILURE)
    try:
        await take_up(
            watcher, revision, consent, timeout_s, lambda text: click.echo(text, err=True)
        )
    except RevisionRefusedError as error:
        fail(f"{team}: revision {number} is refused: {error}", FAILURE)
    if as_json:
        told = {"team": team, "revision": number, "in_force": True, "blocked": blocked}
        click.echo(json.dumps(told | changes.to_json(), indent=2))
    else:
        click.echo(f"{team}: revision {number} is in force")
    return number


async def _withdraw(watcher: Watcher, team: str, as_json: bool) -> int:
    from mrbt_mesh.features.revisions.facts import Revisions
    from mrbt_mesh.runtime.team_revision import withdraw

    facts = watcher.observer.facts
    pending = facts.index(Revisions).pending(facts.in_force.number)
    if pending is None:
        fail(f"{team}: no revision is proposed", FAILURE)
    number = pending[1].number
    is_withdrawn, answer = await withdraw(watcher, number)
    if not is_withdrawn:
        fail(f"{team}: {answer}", FAILURE)
    report(as_json, team, [*watcher.observer.membership.members()], "revise", answer)
    return SUCCESS


def lines(
    changes: RevisionChanges, blocked: Sequence[str], survived: Mapping[str, str]
) -> list[str]:
    """Return what a revision changes, and the losses its team then survives, for people."""
    from mrbt_mesh.features.revisions.changes import step_name, step_names

    def subjects(activations: Sequence[str]) -> str:
        return ", ".join(step_names(activations))

    def works(those: Sequence[tuple[str, str, str]]) -> str:
        return ", ".join(f"{robot}: {task} for {step_name(step)}" for robot, step, task in those)

    found = {
        "stays done": subjects(changes.kept),
        "stays failed": subjects(changes.kept_failed),
        "goes on": works(changes.going_on),
        "begins again": subjects(changes.begun_again),
        "exclusive, again": subjects(changes.repeated),
        "is cancelled": works(changes.cancelled),
        "no longer counts": subjects(changes.dropped),
        "new tasks": ", ".join(changes.new_tasks),
        "new robots": ", ".join(changes.new_robots),
        "robots that leave": ", ".join(changes.removed_robots),
        "jobs without a type": ", ".join(changes.lost_jobs),
        "jobs that end": ", ".join(f"{job} {how}" for job, how in changes.ended_jobs),
        "the mission ends": changes.result,
        "blocked": "; ".join(blocked),
    }
    shown = [f"{what + ':':<20} {text}" for what, text in found.items() if text]
    shown = shown or ["nothing is done or under way, and there are no new tasks or robots"]
    for kind, losses in survived.items():
        what = f"a job {kind} survives" if kind else "it survives"
        shown.append(f"{what + ':':<20} {losses}")
    return shown
