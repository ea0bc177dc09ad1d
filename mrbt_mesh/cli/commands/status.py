"""`mrbt status`: assignments, blocked requests, and whether all robots agree."""

from __future__ import annotations

import contextlib
import json
from typing import TYPE_CHECKING, Any, NoReturn

import click

from mrbt_mesh.cli.command import FAILURE, SUCCESS, MrbtCommand, fail
from mrbt_mesh.cli.commands.operate import nobody, with_team
from mrbt_mesh.cli.options import json_option
from mrbt_mesh.cli.team_options import TeamOptions, team_options

if TYPE_CHECKING:
    from mrbt_mesh.core.facts.records import Claim
    from mrbt_mesh.core.membership.peer import State
    from mrbt_mesh.observer.observer import Observer
    from mrbt_mesh.runtime.run_dir import RunDir
    from mrbt_mesh.runtime.team_address import TeamAddress
    from mrbt_mesh.runtime.watcher import Watcher

SETTLE_BEATS = 2
REFUSALS_TIMEOUT_S = 1.0


@click.command(cls=MrbtCommand)
@team_options
@json_option
def status(team: TeamOptions, as_json: bool) -> None:
    """Show who does what, which requests are blocked, and whether all robots agree.

    Of a run that has ended it shows summary.json. Where nobody has written one, as where `mrbt up`
    was killed, it writes it, and in a team with keys signs that this was done afterwards.

    Example: mrbt status --json
    """
    from mrbt_mesh.cli.finished import print_finished, summary_of_finished

    found = team.run_directory()
    summary = summary_of_finished(found) if found is not None else None
    if summary is not None:
        print_finished(summary, as_json)
        return
    # Only a running team needs Zenoh and the planner.
    _print_status(team.find(), as_json)


def _print_status(team: TeamAddress, as_json: bool) -> NoReturn:
    """Print the status of a team, and end the process; exit status 1 if no robot is heard."""
    import anyio

    from mrbt_mesh.cli.terminal import console, print_json
    from mrbt_mesh.cli.views.status_view import render_status
    from mrbt_mesh.core.membership.timing import SECOND_US

    async def act(watcher: Watcher) -> int:
        if team.run_dir is None and not watcher.observer.robots():
            fail(nobody(watcher), FAILURE)
        # After two heartbeats it is known which robots are silent or suspected.
        with anyio.move_on_after(SETTLE_BEATS * watcher.timing.heartbeat_us / SECOND_US):
            while True:
                await watcher.wait_for_change(0.05)
        watcher.refresh()
        data = status_data(watcher) | {"refused": await _refused(watcher)}
        if as_json:
            print_json(data)
        else:
            console.print(render_status(data))
        return SUCCESS

    with_team(team, act)


async def _refused(watcher: Watcher) -> dict[str, dict[str, int]]:
    """Return how often each live robot that answers refused messages, by "source: reason"."""
    import anyio

    from mrbt_mesh.core.agent.operator_messages import REFUSALS

    found: dict[str, dict[str, int]] = {}

    async def ask(robot: str) -> None:
        good, text = await watcher.command(robot, REFUSALS)
        with contextlib.suppress(ValueError):
            counts = json.loads(text) if good else {}
            if counts:
                found[robot] = counts

    with anyio.move_on_after(REFUSALS_TIMEOUT_S):
        async with anyio.create_task_group() as group:
            for robot in watcher.observer.membership.members():
                group.start_soon(ask, robot)
    return dict(sorted(found.items()))


def status_data(watcher: Watcher) -> dict[str, Any]:
    """Return the status as plain data."""
    from mrbt_mesh.observer.forecast import forecast_of
    from mrbt_mesh.observer.headline import headline, robots_that_differ
    from mrbt_mesh.runtime.fencing import boottime_us
    from mrbt_mesh.runtime.noted_problems import take_noted_problems

    observer, run_dir, now_us = watcher.observer, watcher.address.run_dir, boottime_us()
    started = run_dir.robots() if run_dir is not None else []
    if run_dir is not None:
        take_noted_problems(run_dir, observer.record, now_us)
        for death in run_dir.deaths(now_us):
            observer.record.death_recorded(*death)
    robots = {r: _robot(watcher, r, now_us) for r in sorted({*observer.robots(), *started})}
    plan = observer.plan
    statements = headline(observer, robots_that_differ(observer), now_us)
    waiting = plan.waiting if plan else ()
    forecast = forecast_of(observer, now_us)
    working: dict[str, list[str]] = {}
    for robot, row in robots.items():
        if row["global_task"]:
            working.setdefault(row["global_task"], []).append(robot)
    return {
        "mission": observer.mission.name,
        "revision": observer.mission.number,
        "headline": [statement.to_json() for statement in statements],
        "result": _result(observer),
        "over": observer.is_over,
        "ends": str(observer.mission.ends),
        "robots": robots,
        "global_tasks": {
            name: {"status": str(task.state), "robots": working.get(name, [])}
            for name, task in observer.record.task_log.tasks.items()
        },
        "blackboard": observer.facts.conditions.entries(),
        "forecast": forecast.to_json() if forecast is not None else None,
        "bounds": [bounds.to_json() for bounds in plan.bounds] if plan else [],
        "blocked": [
            {"request": w.global_task, "reason": w.reason} for w in waiting if w.is_blocked
        ],
        "failures": [
            {
                "robot": end.robot,
                "global_task": end.global_task,
                "local_task": end.local_task,
                "reason": end.reason,
            }
            for end in observer.record.failures
        ],
        "waiting": [w.global_task for w in waiting if not w.is_blocked],
        "agreement": observer.agreement,
        "secure": watcher.address.keys is not None,
        "run_dir": str(run_dir.path) if run_dir is not None else None,
    }


def _result(observer: Observer) -> str | None:
    """Return the result of the run if it is over, else of its plan."""
    if observer.ended is not None and observer.record.result is None:
        return observer.ended.result
    return observer.plan.result.name.lower() if observer.plan is not None else None


def _robot(watcher: Watcher, robot: str, now_us: int) -> dict[str, Any]:
    from mrbt_mesh.core.facts.records import PROCESS
    from mrbt_mesh.core.facts.team_facts import changed_performances
    from mrbt_mesh.core.membership.peer import State
    from mrbt_mesh.core.mission.mission import MICRO
    from mrbt_mesh.observer.time_at_work import time_at_work
    from mrbt_mesh.runtime.blocked_loop import SUBJECT

    observer, run_dir = watcher.observer, watcher.address.run_dir
    member = observer.facts.members.get(robot)
    claim = observer.claim(robot)
    state = observer.robot_state(robot)
    problems = dict(observer.facts.problems.get(robot, {}))
    changed = changed_performances(observer.mission, robot, member[0]) if member else {}
    pid = member[0].pid if member is not None and state is not State.DEAD else None
    if run_dir is not None:
        pid, state = _here(run_dir, robot, state)
        problems |= {
            subject: episode.problem
            for (of, subject), episode in observer.record.problems.items()
            if of == robot and subject in (SUBJECT, PROCESS) and episode.to_us is None
        }
    at_work = time_at_work(observer, robot, now_us)
    return {
        "host": member[0].host if member else None,
        "pid": pid,
        "state": str(state),
        "type": member[0].type if member else None,
        "local_task": claim.local_task if claim else None,
        "global_task": claim.global_task if claim else None,
        "values": _values(observer, claim),
        "phase": claim.phase.name.lower() if claim else None,
        "under_way": observer.facts.under_way(robot),
        "at_work_s": round(at_work.for_s, 1) if at_work is not None else None,
        "expected_s": at_work.expected_s if at_work is not None else None,
        "is_overdue": at_work is not None and at_work.is_overdue,
        "lost": dict(member[0].lost) if member else {},
        "pending": dict(member[0].pending) if member else {},
        "problems": problems,
        "performances": {name: value / MICRO for name, value in changed.items()},
    }


def _values(observer: Observer, claim: Claim | None) -> dict[str, str | None]:
    """Return the values that a robot's task reads from the blackboard."""
    task = observer.facts.task_of(claim.activation) if claim is not None else None
    if claim is None or task is None or not task.reads:
        return {}
    read = observer.facts.values_read(claim.activation, task)
    return dict(zip(task.reads, read, strict=True))


def _here(run_dir: RunDir, robot: str, state: State) -> tuple[int | None, State]:
    """Return (pid, state) of a robot whose process may run, or have run, on this machine."""
    from mrbt_mesh.core.membership.peer import State

    process = run_dir.process(robot)
    if process is not None:
        return process.pid, state
    if state is State.ALIVE and robot in run_dir.robots():
        # Its process has ended, and nobody has heard it since.
        return None, State.SUSPECT
    return None, state
