"""Watches a team until its mission is over, and prints the result; it decides nothing."""

from __future__ import annotations

import contextlib
import signal
import sys
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Iterable, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import urlsplit, urlunsplit

import anyio
import click

from mrbt_mesh import plugins
from mrbt_mesh.cli.command import BAD_INPUT, EXIT_OF_RESULT, SUCCESS
from mrbt_mesh.cli.finished import print_summary
from mrbt_mesh.cli.guide import Guide
from mrbt_mesh.cli.operator_end import with_operator_end
from mrbt_mesh.cli.options import ShowOptions
from mrbt_mesh.cli.plugged import ChosenViews
from mrbt_mesh.cli.terminal import errors, print_json
from mrbt_mesh.errors import InputError
from mrbt_mesh.observer.observer import Observer
from mrbt_mesh.observer.summary import run_summary
from mrbt_mesh.recording.folder import observer_files, robot_files
from mrbt_mesh.runtime.capacity import Overload
from mrbt_mesh.runtime.fencing import boottime_us
from mrbt_mesh.runtime.known_runs import known_runs
from mrbt_mesh.runtime.observer_recording import RecordTo
from mrbt_mesh.runtime.past import tell_past
from mrbt_mesh.runtime.summary_signature import sign_summary
from mrbt_mesh.runtime.team import Team
from mrbt_mesh.runtime.team_address import TeamAddress
from mrbt_mesh.runtime.watcher import Watcher, watching

if TYPE_CHECKING:
    from mrbt_mesh.plugins import MetricsAddress, OpenView, ViewerOptions

# For views: how long messages are collected, and the longest time between two looks.
BATCH_S, FRAME_S = 0.1, 0.25
CATCH_UP_S = 1.0
STOPPED, TIME_IS_UP = "stopped by the operator", "time is up"
LOOK_S = 0.2
# Recordings of this size take seconds to read.
LARGE_MB = 2.0
TERMINAL_VIEW = "top"
# The ending of the name of a view's address at a proxy.
_PUBLIC = "_public"


def print_where(address: TeamAddress, show: ShowOptions) -> None:
    """Print the team to look for, which may not exist yet."""
    if not show.as_json and not _is_live(show):
        click.echo(f"listening for team {address.transport.team}, run {address.run}")


def wait_for_a_run() -> None:
    """Wait until this machine has a run, if it has none."""
    if known_runs():
        return
    click.echo("no run is known here: waiting for the first one (mrbt up MISSION)", err=True)
    while not known_runs():
        time.sleep(LOOK_S)


def machine_view(views: ChosenViews) -> str | None:
    """Return the view's name if it is the only one and can show all runs of this machine."""
    found = [n for n, viewer in views.viewers.items() if isinstance(viewer, plugins.MachineViewer)]
    return found[0] if len(found) == len(views.viewers) == 1 else None


async def show_machine(name: str, views: ChosenViews, show: ShowOptions) -> int:
    """Show all runs of this machine in the view `name`, until time is up or Ctrl-C.

    Returns the exit status. Raises InputError for an address that cannot be used.
    """
    viewer = views.viewers[name]
    assert isinstance(viewer, plugins.MachineViewer)
    with anyio.move_on_after(show.timeout):
        async with viewer.showing_machine(views.options) as address:
            public_url = views.options.public_url
            await served_until_interrupted(name, address, show.as_json, public_url)
    return SUCCESS


async def served_until_interrupted(
    name: str, address: str, as_json: bool, public_url: str = ""
) -> None:
    """Print the address of a server, and that of its proxy if it has one, then wait.

    Returns on SIGINT or SIGTERM.
    """
    found = addresses_by_name({name: address}, public_url)
    if as_json:
        print_json(found)
    else:
        click.echo("\n".join(address_lines(found)))
    sys.stdout.flush()
    with anyio.open_signal_receiver(signal.SIGINT, signal.SIGTERM) as signals:
        async for _ in signals:
            break


def public_address(address: str, public_url: str) -> str:
    """Return the address behind a proxy at `public_url`; empty without a proxy."""
    parts = urlsplit(address)
    if not public_url or parts.scheme not in ("http", "https"):
        return ""
    return urlunsplit((*urlsplit(public_url + parts.path)[:3], parts.query, parts.fragment))


def addresses_by_name(served: Mapping[str, str], public_url: str) -> dict[str, str]:
    """Return the addresses by view; that at a proxy is called `NAME_public`."""
    found = {}
    for name, address in served.items():
        found[name] = address
        if public := public_address(address, public_url):
            found[f"{name}{_PUBLIC}"] = public
    return found


def address_lines(addresses: Mapping[str, str]) -> list[str]:
    """Return the addresses of `addresses_by_name` for people, one per line."""
    return [
        f"{name.removesuffix(_PUBLIC)}, by --public-url: {address}"
        if name.endswith(_PUBLIC)
        else f"{name}: {address}"
        for name, address in addresses.items()
    ]


def say_if_large(files: Iterable[Path]) -> None:
    """Print a note on stderr if reading these recordings takes seconds."""
    size_mb = sum(file.stat().st_size / 1e6 for file in files if file.exists())
    if size_mb >= LARGE_MB:
        click.echo(f"reading {size_mb:.0f} MB of recordings ...", err=True)


def past_of(team: Team | None) -> Callable[[Observer], None] | None:
    """Return a function that adds a local team's recorded past to an observer."""
    if team is None:
        return None
    path, started_unix_s = team.run_dir.path, team.info.started_unix_s
    living = team.living()

    def tell(observer: Observer) -> None:
        say_if_large([*observer_files(path), *robot_files(path)])
        tell_past(observer, path, started_unix_s, living)

    return tell


def print_refusals(refused: list[str]) -> None:
    """Print the messages of robots that refused their input; equal ones once."""
    for text in dict.fromkeys(refused):
        errors.print(text, soft_wrap=True)


def _is_live(show: ShowOptions) -> bool:
    """True if a view shows the run in the terminal; otherwise lines are printed."""
    if show.headless or show.as_json or TERMINAL_VIEW not in plugins.VIEWS.names():
        return False
    try:
        plugins.VIEWS.load(TERMINAL_VIEW).check(plugins.ViewerOptions())
    except InputError:
        return False
    return True


@dataclass
class Session:
    """A session in which a team is watched.

    Its methods raise TransportError if there is no way to attach, InputError for files, views and
    ports that cannot be opened.

    `team` holds the processes, if they run on this machine. `overload` tells by how much the team
    is too large for the machine. `past` adds earlier events. `guide` shows a newcomer around.
    `end_team` ends the robots that were launched here; with it, views that stay are open after the
    end of the run.
    """

    address: TeamAddress
    team: Team | None
    show: ShowOptions
    views: ChosenViews
    metrics: MetricsAddress | None = None
    record: RecordTo | None = None
    overload: Overload | None = None
    past: Callable[[Observer], None] | None = None
    guide: Guide | None = None
    end_team: Callable[[], Awaitable[None]] | None = None

    async def run(self) -> int:
        """Watch until the mission is over, time is up, no robot is left, or Ctrl-C.

        Prints the summary, and writes summary.json if the team was launched here. Views that stay
        are then shown until time is up or Ctrl-C. Returns the exit status.
        """
        deadline = self._deadline()
        async with self._opened() as (watcher, opened), anyio.create_task_group() as group:
            for line in _address_lines(opened, self.views.options):
                click.echo(line, err=self.show.as_json)
            if self.team is not None:
                group.start_soon(self.team.note_exits, watcher)
            if self.guide is not None and self.team is not None:
                group.start_soon(self.guide.kill_one, watcher, self.team)
            async with self._display(watcher, opened) as refresh:
                why = await self._until_over(watcher, opened, refresh, deadline)
            stay = {name: view for name, view in opened.items() if view.stays}
            if why not in (STOPPED, TIME_IS_UP) and self.end_team is not None and stay:
                status = self._report(watcher, why)
                await self.end_team()
                for line in _address_lines(stay, self.views.options):
                    click.echo(f"{line} stays until Ctrl-C", err=self.show.as_json)
                sys.stdout.flush()
                how = (watcher, stay, lambda: None, deadline)
                await self._until_over(*how, is_endless=True)
                group.cancel_scope.cancel()
                return status
            group.cancel_scope.cancel()
        # By now every view has left the terminal.
        return self._report(watcher, why)

    def _deadline(self) -> float:
        """Return when time is up."""
        timeout_s = self.show.timeout
        return float("inf") if timeout_s is None else anyio.current_time() + timeout_s

    async def follow(self) -> int:
        """Show the views until one is closed, time is up, or Ctrl-C. Returns the exit status."""
        async with self._opened() as (watcher, opened), anyio.create_task_group() as group:
            if self.team is not None:
                if not self.team.living():
                    # The run is over, and only its journals are left.
                    self.team.result(watcher.observer, boottime_us())
                    self.team.note_unseen_deaths(watcher.observer, boottime_us())
                group.start_soon(self.team.note_exits, watcher)
            if self.show.as_json:
                print_json(_addresses(opened, self.views.options))
            else:
                for line in _address_lines(opened, self.views.options):
                    click.echo(line)
            sys.stdout.flush()
            how = (watcher, opened, lambda: None, self._deadline())
            await self._until_over(*how, is_endless=True)
            group.cancel_scope.cancel()
        return SUCCESS

    @contextlib.asynccontextmanager
    async def _opened(self) -> AsyncIterator[tuple[Watcher, dict[str, OpenView]]]:
        """Yield the watcher, and the open views by name."""
        async with contextlib.AsyncExitStack() as stack:
            watcher = await stack.enter_async_context(
                watching(self.address, self.record, tell_past=self.past, batch_s=BATCH_S)
            )
            if self.metrics is not None:
                stack.enter_context(plugins.metrics().serving_team(watcher.observer, self.metrics))
            opened = {
                name: await stack.enter_async_context(
                    viewer.showing(watcher, self.team, self.views.options)
                )
                for name, viewer in self.views.viewers.items()
            }
            yield watcher, opened

    @contextlib.asynccontextmanager
    async def _display(
        self, watcher: Watcher, opened: dict[str, OpenView]
    ) -> AsyncIterator[Callable[[], None]]:
        """Show the run in the terminal, unless a view does.

        A terminal view is added to `opened`. If there is none, the yielded function prints new
        lines.
        """
        if self.show.as_json or not all(view.address for view in opened.values()):
            yield lambda: None
            return
        guide = self.guide
        if _is_live(self.show):
            lasting = _address_lines(opened, self.views.options)
            if self.overload is not None:
                lasting.append(f"{self.overload.robots} robots are too many for this machine")

            def notes() -> list[str]:
                return [*(guide.hints() if guide is not None else ()), *lasting]

            options = replace(self.views.options, has_control=False, notes=notes)
            viewer = plugins.VIEWS.load(TERMINAL_VIEW)
            async with viewer.showing(watcher, self.team, options) as view:
                opened[TERMINAL_VIEW] = view
                yield lambda: None
            return
        printed = 0

        def print_lines() -> None:
            nonlocal printed
            for hint in guide.new_hints() if guide is not None else ():
                click.echo(hint)
            record = watcher.observer.record
            for _, (at_us, text) in record.timeline.since(printed):
                seconds = record.seconds(at_us) or 0.0
                click.echo(f"{seconds:8.2f}  {text}")
            printed = record.timeline.total

        yield print_lines

    async def _until_over(
        self,
        watcher: Watcher,
        opened: Mapping[str, OpenView],
        refresh: Callable[[], None],
        deadline: float,
        is_endless: bool = False,
    ) -> str | None:
        """Return why watching ended before the mission did, or None if the mission is over."""
        checked = anyio.current_time()
        stop = anyio.Event()

        async def wait_for_signal() -> None:
            with anyio.open_signal_receiver(signal.SIGINT, signal.SIGTERM) as signals:
                async for _ in signals:
                    stop.set()
                    watcher.changed.set()

        def update() -> None:
            for view in opened.values():
                view.update()
            refresh()

        async with anyio.create_task_group() as group:
            group.start_soon(wait_for_signal)
            why: str | None = None
            while why is None and (is_endless or watcher.observer.record.result is None):
                await watcher.wait_for_change(FRAME_S)
                update()
                now = anyio.current_time()
                if now >= deadline:
                    why = TIME_IS_UP
                elif stop.is_set() or any(view.closed.is_set() for view in opened.values()):
                    why = STOPPED
                elif now > checked + 1:
                    checked = now
                    if not is_endless and self.team is not None and not self.team.living():
                        why = "no robot is left"
            if not is_endless:
                # A watcher that came late may know the result before the events that led to it.
                await watcher.catch_up(CATCH_UP_S)
                update()
            group.cancel_scope.cancel()
        return why

    def _report(self, watcher: Watcher, why: str | None) -> int:
        team, observer = self.team, watcher.observer
        refused = team.refusals() if team is not None else []
        if observer.record.started_us is None and refused:
            print_refusals(refused)
            return BAD_INPUT
        now_us = boottime_us()
        if team is not None:
            result = team.result(observer, now_us)
            if why != STOPPED:
                team.note_unseen_deaths(observer, now_us)
        else:
            result = observer.result(anybody_lives=bool(observer.membership.members()))
        summary = run_summary(observer, result, now_us)
        if why is not None:
            summary["ended_because"] = why
            run_dir = team.run_dir if team is not None and team.is_launched_here else None
            by = why if why == STOPPED else ""
            summary = with_operator_end(summary, observer.record, run_dir, by)
        if self.overload is not None:
            summary["overload"] = asdict(self.overload)
        if team is not None:
            summary["run_dir"] = str(team.run_dir.path)
        if team is not None and team.is_launched_here:
            try:
                team.run_dir.write_summary(summary)
                sign_summary(team.run_dir)
            except InputError as error:
                errors.print(str(error), soft_wrap=True)
        print_summary(summary, self.show.as_json)
        print_refusals(refused)
        if self.guide is not None and team is not None and not self.show.as_json:
            click.echo("\n".join(self.guide.closing(team)))
        return EXIT_OF_RESULT[summary["result"]]


def _addresses(opened: Mapping[str, OpenView], options: ViewerOptions) -> dict[str, str]:
    served = {name: view.address for name, view in opened.items() if view.address}
    return addresses_by_name(served, options.public_url)


def _address_lines(opened: Mapping[str, OpenView], options: ViewerOptions) -> list[str]:
    return address_lines(_addresses(opened, options))
