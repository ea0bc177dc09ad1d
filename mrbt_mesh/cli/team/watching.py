"""Watch a team until its mission is over, and tell how it went. Who watches decides nothing."""

from __future__ import annotations

import contextlib
import signal
from collections.abc import AsyncIterator, Callable
from dataclasses import asdict
from typing import TYPE_CHECKING, TypeAlias

import anyio
import click
from rich.live import Live

from mrbt_mesh.cli.exporting import LookOn
from mrbt_mesh.cli.framework.exits import BAD_INPUT, EXIT_OF_RESULT
from mrbt_mesh.cli.framework.terminal import console, errors
from mrbt_mesh.cli.team.finished import tell_summary
from mrbt_mesh.cli.team.sharing import Share, shares_nothing
from mrbt_mesh.cli.team.show_options import ShowOptions
from mrbt_mesh.cli.views.overload_view import overload_line
from mrbt_mesh.core.observer.summary import run_summary
from mrbt_mesh.runtime.capacity import Overload
from mrbt_mesh.runtime.fencing import boottime_us
from mrbt_mesh.runtime.recording import RecordTo
from mrbt_mesh.runtime.run_dir import RunDirError
from mrbt_mesh.runtime.team import Team
from mrbt_mesh.runtime.team_address import TeamAddress
from mrbt_mesh.runtime.watcher import Watcher, watching
from mrbt_mesh.views.terminal.live import LiveNotes, LiveView

if TYPE_CHECKING:
    from mrbt_mesh.views.web.feed import Feed
    from mrbt_mesh.views.web.server import PageOptions

FRAME_S = 0.1
CATCH_UP_S = 1.0

Display: TypeAlias = contextlib.AbstractAsyncContextManager[Callable[[], None]]


async def watch(
    address: TeamAddress,
    team: Team | None,
    show: ShowOptions,
    too_many: Overload | None = None,
    share: Share = shares_nothing,
    record: RecordTo | None = None,
    page: PageOptions | None = None,
) -> int:
    """Watch until the mission is over, time is up, nobody is left, or the operator stops it.

    `team`: its processes, if they are of this machine; of others robots may yet come. `too_many`:
    what was found of a team that is too large for this machine. `share` is open meanwhile.
    `record`: where to record what is heard. `page`: also in a browser. Returns the exit status.
    Raises TransportError if there is no way to attach, InputError if nothing can be recorded, or
    there is nothing to serve the page.
    """
    async with (
        watching(address, record) as watcher,
        _page(watcher, team, page, show) as (shown, feed),
    ):
        warning = "" if too_many is None else overload_line(too_many)
        display = _display(watcher, show, LiveNotes(warning, shown), feed)
        with share(watcher) as look_on:
            async with anyio.create_task_group() as group:
                if team is not None:
                    group.start_soon(team.note_exits, watcher)
                why = await _until_over(team, watcher, show, display, look_on)
                group.cancel_scope.cancel()
        return _report(team, watcher, show, why, too_many)


def _is_live(show: ShowOptions) -> bool:
    return not show.headless and not show.as_json and console.is_terminal


def say_where(address: TeamAddress, show: ShowOptions) -> None:
    """Where a team is looked for that may not be there yet."""
    if not show.as_json and not _is_live(show):
        click.echo(f"listening for team {address.transport.team}, run {address.run}")


@contextlib.asynccontextmanager
async def _page(
    watcher: Watcher, team: Team | None, options: PageOptions | None, show: ShowOptions
) -> AsyncIterator[tuple[str, Feed | None]]:
    """(the page's address, what tells it of updates), if there is to be a page."""
    if options is None:
        yield "", None
        return
    from mrbt_mesh.views.web.server import serving

    async with serving(watcher, team, options) as (shown, feed):
        click.echo(f"page: {shown}", err=show.as_json)
        yield shown, feed


@contextlib.asynccontextmanager
async def _display(
    watcher: Watcher, show: ShowOptions, notes: LiveNotes, feed: Feed | None
) -> AsyncIterator[Callable[[], None]]:
    """A function that shows the present state: the live view, new lines, or nothing; and a page."""
    async with _terminal(watcher, show, notes) as refresh:

        def both() -> None:
            refresh()
            if feed is not None:
                feed.update()

        yield both


@contextlib.asynccontextmanager
async def _terminal(
    watcher: Watcher, show: ShowOptions, notes: LiveNotes
) -> AsyncIterator[Callable[[], None]]:
    observer = watcher.observer
    if _is_live(show):
        with Live(console=console, screen=True, auto_refresh=False) as live:
            view = LiveView()
            yield lambda: live.update(
                view.render(observer, boottime_us(), console.size, notes), refresh=True
            )
        return
    printed = 0

    def lines() -> None:
        nonlocal printed
        for at_us, text in observer.record.timeline[printed:]:
            seconds = observer.record.seconds(at_us) or 0.0
            click.echo(f"{seconds:8.2f}  {text}")
        printed = len(observer.record.timeline)

    yield (lambda: None) if show.as_json else lines


async def _until_over(
    team: Team | None,
    watcher: Watcher,
    show: ShowOptions,
    display: Display,
    look_on: LookOn,
) -> str | None:
    """Why watching ended before the mission did, or None if the mission is over."""
    checked = anyio.current_time()
    deadline = checked + show.timeout if show.timeout is not None else float("inf")
    stop = anyio.Event()

    async def wait_for_signal() -> None:
        with anyio.open_signal_receiver(signal.SIGINT, signal.SIGTERM) as signals:
            async for _ in signals:
                stop.set()
                watcher.changed.set()

    async with anyio.create_task_group() as group, display as refresh:
        group.start_soon(wait_for_signal)
        why: str | None = None
        while watcher.observer.record.result is None and why is None:
            await watcher.wait_for_change(FRAME_S)
            look_on(watcher.observer, boottime_us())
            refresh()
            now = anyio.current_time()
            if now >= deadline:
                why = "time is up"
            elif stop.is_set():
                why = "stopped by the operator"
            elif now > checked + 1:
                checked = now
                if team is not None and not team.living():
                    why = "no robot is left"
        # Who came late may know the result before what led to it.
        await watcher.catch_up(CATCH_UP_S)
        look_on(watcher.observer, boottime_us())
        refresh()
        group.cancel_scope.cancel()
    return why


def _report(
    team: Team | None,
    watcher: Watcher,
    show: ShowOptions,
    why: str | None,
    too_many: Overload | None,
) -> int:
    """Print the summary and write summary.json; returns the exit status."""
    refused = team.refusals() if team is not None else []
    observer = watcher.observer
    if observer.record.started_us is None and refused:
        print_refusals(refused)
        return BAD_INPUT
    now_us = boottime_us()
    if team is not None:
        result = team.result(observer, now_us)
    else:
        result = observer.result(anybody_lives=bool(observer.membership.members()))
    summary = run_summary(observer.record, result, now_us)
    if why is not None:
        summary["ended_because"] = why
    if too_many is not None:
        summary["overload"] = asdict(too_many)
    if team is not None:
        summary["run_dir"] = str(team.run_dir.path)
        try:
            team.run_dir.write_summary(summary)
        except RunDirError as error:
            errors.print(str(error), soft_wrap=True, markup=False)
    tell_summary(summary, show.as_json)
    print_refusals(refused)
    return EXIT_OF_RESULT[result]


def print_refusals(refused: list[str]) -> None:
    """What robots said that refused their input; what several said, once."""
    for text in dict.fromkeys(refused):
        errors.print(text, soft_wrap=True, markup=False)
