"""Proposes another mission to a running team: what would change, and the steps until it is in
force.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import anyio
import anyio.abc

from mrbt_mesh.core.membership.timing import SECOND_US
from mrbt_mesh.core.mission.compiled import compile_mission
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.errors import InputError, MissingExtraError, lone
from mrbt_mesh.features.revisions.changes import (
    RevisionChanges,
    as_revision,
    facts_under,
    revision_changes,
)
from mrbt_mesh.features.revisions.facts import Revisions
from mrbt_mesh.features.revisions.messages import CHECK_REVISION
from mrbt_mesh.features.revisions.objections import not_feasible, objections
from mrbt_mesh.features.revisions.revise import RevisionError
from mrbt_mesh.features.revisions.reviser import size_problem
from mrbt_mesh.plugins import ANALYSES
from mrbt_mesh.runtime.operator_call import CommandRefusedError
from mrbt_mesh.runtime.team_client import TeamClient
from mrbt_mesh.runtime.watcher import Watcher

# How long an operator who interrupts waits for an answer.
WITHDRAW_S = 2.0
# How long robots may take to check their programs. A robot imports its program again for it, which
# is slow if many processes share few cores.
CHECK_S, CHECK_AGAIN_S = 20.0, 0.1


@dataclass(frozen=True, slots=True)
class Consent:
    """What the operator accepts, and signs with the revision.

    `is_forced`: work may be cancelled, and robots may leave. `repeats_exclusive`: exclusive tasks
    that have begun may begin again.
    """

    is_forced: bool = False
    repeats_exclusive: bool = False


class RevisionRefusedError(Exception):
    """The team refuses a revision; the message says who refuses it, and why."""


def next_revision(watcher: Watcher, mission: Mission) -> tuple[Mission, RevisionChanges]:
    """Return the mission as the next revision of the one in force, and what it would change now.

    Raises InputError if no team could use it.
    """
    facts = watcher.observer.facts
    try:
        found = as_revision(facts, mission)
    except RevisionError as error:
        raise InputError(str(error)) from None
    return found, revision_changes(facts, found, watcher.observer.membership.members())


def unserved(watcher: Watcher, mission: Mission) -> list[str]:
    """Return what the living robots could not do in this revision, and why."""
    observer = watcher.observer
    return not_feasible(observer.facts, mission, observer.membership.members())


async def refusals(
    watcher: Watcher, mission: Mission, changes: RevisionChanges, consent: Consent
) -> list[str]:
    """Return why the team would refuse this revision now, each with the remedy.

    Empty if it would not.
    """
    observer = watcher.observer
    before, alive = observer.facts.in_force, observer.membership.members()
    found = [size_problem(before, mission, watcher.timing)]
    found += objections(
        observer.facts,
        mission,
        changes,
        alive,
        is_forced=consent.is_forced,
        may_repeat=consent.repeats_exclusive,
    )
    text, problems = compile_mission(mission), dict[str, str]()

    async def ask(robot: str) -> None:
        with anyio.move_on_after(CHECK_S):
            while True:
                good, answer = await watcher.command(robot, CHECK_REVISION, text)
                problem = json.loads(answer)["problem"] if good else answer
                if problem is not None:
                    problems[robot] = problem
                    return
                await anyio.sleep(CHECK_AGAIN_S)
        problems[robot] = f"it has not looked at its program within {CHECK_S:g} s; ask again"

    async with anyio.create_task_group() as group:
        for robot in alive.keys() & mission.robots.keys():
            group.start_soon(ask, robot)
    found += [f"{robot}: {problems[robot]}" for robot in sorted(problems) if problems[robot]]
    return [each for each in found if each]


def survived_losses(watcher: Watcher, mission: Mission) -> Mapping[str, str]:
    """Return in words which losses a revision survives with the living robots and their abilities
    now.

    By type of jobs, or under "". Empty if no analysis is installed.
    """
    observer = watcher.observer
    members = facts_under(observer.facts, mission).members
    robots = {
        name: replace(robot, capabilities=members[name].member.capabilities)
        for name, robot in mission.robots.items()
        if name in members and name in observer.membership.members()
    }
    if not robots or "tolerance" not in ANALYSES.names():
        return {}
    try:
        return ANALYSES.load("tolerance")(replace(mission, robots=robots))
    except MissingExtraError as error:
        return {"": f"not known: {error}"}


async def take_up(
    watcher: Watcher,
    revision: Mission,
    consent: Consent,
    timeout_s: float,
    say: Callable[[str], None],
) -> None:
    """Propose a revision, and wait until it is in force and all robots act by it.

    `say` gets the awaited robots whenever they change. Raises RevisionRefusedError if a robot
    refuses it, or if it is not in force after `timeout_s`: then it is withdrawn.
    """
    client, number = TeamClient(watcher), revision.number
    if not client.robots:
        raise RevisionRefusedError("no robot of the team is heard")
    awaited: list[str] = []
    late = ""
    try:
        with anyio.move_on_after(timeout_s):
            await _propose(client, revision, consent, awaited, say)
            return
    except CommandRefusedError as error:
        raise RevisionRefusedError(str(error)) from None
    except TimeoutError as error:
        late = str(error)
        proposed = watcher.observer.facts.index(Revisions).proposed(number)
        if proposed is not None and proposed.text != compile_mission(revision):
            raise RevisionRefusedError(late) from None  # it is another client's, which may continue
    except anyio.get_cancelled_exc_class():
        with anyio.move_on_after(WITHDRAW_S, shield=True):
            await withdraw(watcher, number)
        raise
    if not late:
        waited_for = ", ".join(awaited) or "a majority of the robots"
        late = f"not in force after {timeout_s:g} s, waited for {waited_for}"
    is_withdrawn, answer = await withdraw(watcher, number)
    if not is_withdrawn and await _is_in_force(watcher, revision):
        say(f"in force, though not within {timeout_s:g} s")
        return
    raise RevisionRefusedError(f"{late}: {answer}")


async def _propose(
    client: TeamClient,
    revision: Mission,
    consent: Consent,
    awaited: list[str],
    say: Callable[[str], None],
) -> None:
    """Propose a revision and wait until it is in force.

    A robot that leaves by it may be gone before it has answered, so answers are no longer awaited
    once the revision is in force.
    """
    number, text = revision.number, compile_mission(revision)

    async def wait(group: anyio.abc.TaskGroup) -> None:
        await _until_in_force(client.watcher, revision, text, awaited, say)
        group.cancel_scope.cancel()

    try:
        async with anyio.create_task_group() as group:
            group.start_soon(wait, group)
            await client.propose(number, text, consent.is_forced, consent.repeats_exclusive)
    except BaseExceptionGroup as error:
        raise lone(error) from None


async def withdraw(watcher: Watcher, number: int) -> tuple[bool, str]:
    """Withdraw a proposal.

    Returns whether no robot that is heard can accept it any more, and why.
    """
    client = TeamClient(watcher)
    if not client.robots:
        return False, "no robot of the team is heard, so it is still proposed"
    try:
        await client.withdraw(number)
    except (CommandRefusedError, TimeoutError) as error:
        return False, str(error)
    return True, f"revision {number} is withdrawn"


async def _is_in_force(watcher: Watcher, revision: Mission) -> bool:
    """Return whether exactly this mission has come into force; waits until that is known here."""
    with anyio.move_on_after(WITHDRAW_S):
        while watcher.observer.facts.in_force.number < revision.number:
            await watcher.wait_for_change(watcher.timing.heartbeat_us / SECOND_US)
    return watcher.observer.facts.in_force.digest == revision.digest


async def _until_in_force(
    watcher: Watcher,
    revision: Mission,
    text: str,
    awaited: list[str],
    say: Callable[[str], None],
) -> None:
    """Wait until all robots act by a revision; `awaited` lists the robots that do not yet.

    `text`: the compiled revision, which distinguishes it from another one of the same number.
    """
    observer, said, number = watcher.observer, "", revision.number
    while True:
        revisions, robots = observer.facts.index(Revisions), observer.membership.members()
        mission = observer.facts.in_force
        in_force, proposed = mission.number, revisions.proposed(number)
        is_known = proposed is not None and proposed.text == text
        is_in_force = in_force > number or mission.digest == revision.digest
        if is_in_force and revisions.all_act_by(in_force, robots):
            return
        if is_known and in_force < number and (reason := revisions.void_reason(number)):
            raise RevisionRefusedError(reason)
        if is_known or is_in_force:
            awaited[:] = revisions.awaited(number, in_force, robots)
            news = f"waiting for {', '.join(awaited)}" if awaited else "all hold it"
            if news != said:
                say(news)
                said = news
        await watcher.wait_for_change(watcher.timing.heartbeat_us / SECOND_US)
