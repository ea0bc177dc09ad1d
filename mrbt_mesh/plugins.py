"""Plug-ins of the mesh: entry points, with one group for each kind of plug-in.

The mesh runs without its plug-ins, which pyproject.toml lists under `[project.entry-points]`; other
packages may register plug-ins in the same groups. An entry point names an object that is cheap to
import: whatever needs an extra is imported when the plug-in is used, after `errors.require`.
"""

from __future__ import annotations

import socket
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractAsyncContextManager, AbstractContextManager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, Protocol, TypeVar, runtime_checkable

from mrbt_mesh.errors import InputError, is_installed

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

    import anyio
    import click

    from mrbt_mesh.core.agent.effects import Effect
    from mrbt_mesh.core.agent.inputs import Input
    from mrbt_mesh.core.agent.view import AgentView
    from mrbt_mesh.core.engine import Engine
    from mrbt_mesh.core.mission.conditions import ConditionType
    from mrbt_mesh.core.mission.mission import Mission
    from mrbt_mesh.core.mission.program_trees import ProgramTree
    from mrbt_mesh.observer.observer import Observer
    from mrbt_mesh.runtime.context import TaskContext
    from mrbt_mesh.runtime.journal_writer import Durations
    from mrbt_mesh.runtime.team import Team
    from mrbt_mesh.runtime.watcher import Watcher

_Plugin = TypeVar("_Plugin")
_Function = TypeVar("_Function", bound=Callable[..., Any])
_Node = TypeVar("_Node", bound=type)


@dataclass(frozen=True)
class Group(Generic[_Plugin]):
    """The plug-ins of one kind; `what` is the kind in messages."""

    name: str
    what: str

    def names(self) -> list[str]:
        """Return the names of the installed plug-ins, sorted."""
        return sorted(_installed(self.name))

    def load(self, name: str) -> _Plugin:
        """Load the plug-in called `name`. Raises InputError if it is not installed."""
        found = _installed(self.name).get(name)
        if found is None:
            known = ", ".join(self.names()) or "none"
            raise InputError(f"the {self.what} {name!r} is not installed; installed: {known}")
        plugin: _Plugin = found.load()
        return plugin


@cache
def _installed(group: str) -> Mapping[str, EntryPoint]:
    # This takes some 40 ms and a megabyte, which robots without plug-ins save.
    from importlib.metadata import entry_points

    return {each.name: each for each in entry_points(group=group) if is_installed(each.module)}


@dataclass(frozen=True)
class ViewerOptions:
    """Options of a view; each view uses those that apply to it.

    `port` None is the view's default port, 0 any free one. `has_control`: the view may act on the
    team. `robot`: show the tree of this robot. `notes` returns the lines to show with the team now,
    e.g. a warning. `public_url` is the address at which a proxy serves the view, empty if there is
    none.
    """

    host: str = "127.0.0.1"
    port: int | None = None
    has_control: bool = False
    robot: str | None = None
    notes: Callable[[], Sequence[str]] = tuple
    public_url: str = ""


def check_listens(host: str, port: int, what: str) -> None:
    """Raise InputError if `what` cannot listen there now; port 0 is any free one."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        with socket.socket(family, socket.SOCK_STREAM) as tried:
            # As servers do: a closed connection that still holds the port is no obstacle.
            tried.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            tried.bind((host, port))
            tried.listen()
    except OSError as error:
        why = error.strerror or str(error)
        text = f"{what} cannot listen at {host} port {port}: {why} (--port 0: any that is free)"
        raise InputError(text) from None


@dataclass(frozen=True)
class OpenView:
    """An open view.

    `address` is where it is served, if it is. `update` is called after every change, in the event
    loop; `closed` is set when the user closes the view. `stays`: `mrbt up` keeps it open after the
    end of the run.
    """

    address: str
    update: Callable[[], None]
    closed: anyio.Event
    stays: bool = False


class Viewer(Protocol):
    """Shows a running team: `mrbt watch --NAME`, `mrbt up --NAME`."""

    summary: str

    def check(self, options: ViewerOptions) -> None:
        """Raise InputError, before a team is started, if the view cannot be shown."""

    def showing(
        self, watcher: Watcher, team: Team | None, options: ViewerOptions
    ) -> AbstractAsyncContextManager[OpenView]:
        """Show the team until the context ends; `team` has its processes if they are local."""


@runtime_checkable
class MachineViewer(Protocol):
    """A viewer that can also show all runs of this machine: `mrbt watch --NAME` without a team."""

    def showing_machine(self, options: ViewerOptions) -> AbstractAsyncContextManager[str]:
        """Show the runs until the context ends. Yields the address."""


@dataclass(frozen=True)
class MetricsAddress:
    """Where metrics are served: the port, and the address of the interface."""

    port: int
    host: str = "127.0.0.1"

    def __str__(self) -> str:
        return f"{self.host}:{self.port}"


class RobotMeter(Protocol):
    """Counts the inputs and effects of one robot, and serves the counts. It changes nothing.

    `sync_s` are the durations of synced writes to the journal. `dropped` counts messages that the
    inbox dropped.
    """

    sync_s: Durations
    dropped: int

    def take(self, event: Input) -> None:
        """Count an input of the agent."""

    def carry_out(self, effect: Effect) -> None:
        """Count an effect of the agent."""

    def look(self, lag_s: float, agrees: bool) -> None:
        """Note how late the event loop was, and whether all robots agree with this one."""

    def timed(self, engine: Engine) -> Engine:
        """Return the engine with each plan timed."""

    def serving(self, view: AgentView) -> AbstractContextManager[int]:
        """Serve the counts until the context ends; called in the event loop. Raises InputError."""


class Metrics(Protocol):
    """Serves metrics of robots and teams: `--metrics-port`."""

    def check(self) -> None:
        """Raise InputError if a required library is missing."""

    def meter(self, robot: str, mission: Mission, address: MetricsAddress) -> RobotMeter:
        """Return the meter of one robot, to be served at the address. Raises InputError."""

    def serving_team(
        self, observer: Observer, address: MetricsAddress
    ) -> AbstractContextManager[int]:
        """Serve metrics of a team, in the event loop, until the context ends. Raises InputError."""

    def team_page(self, observer: Observer, accept: str) -> tuple[bytes, str]:
        """Return (page, content type) of a team, for a request with this `Accept` header."""


@dataclass(frozen=True)
class ProgramKind:
    """A kind of robots: `mrbt new FOLDER --NAME` copies the files in the folder `template`.

    `hint` tells what to do first with the new files, which are in {folder}; may be empty.
    """

    summary: str
    template: Path
    hint: str = ""


class LeafRegistry(Protocol):
    """The leaves, entries and enums of a robot's program for trees of one format."""

    enums: dict[str, int]

    def action(self, name: str) -> Callable[[_Function], _Function]: ...
    def condition(self, name: str) -> Callable[[_Function], _Function]: ...
    def node(self, name: str) -> Callable[[_Node], _Node]: ...
    def entry(self, name: str) -> Callable[[_Function], _Function]: ...
    def source(self, name: str) -> Callable[[_Function], _Function]: ...


class TreeFormat(Protocol):
    """A format of tree files, which missions name as local tasks: `tree: FILE.xml#TreeID`."""

    def read(self, path: Path, tree: str) -> tuple[str, str]:
        """Return the text of the file with all its includes, and the tree's ID.

        `tree` may be empty. Raises InputError, with one line for each problem.
        """

    def leaves(self) -> LeafRegistry:
        """Return an empty registry for one robot's program."""

    def problems(
        self, tree: ProgramTree, leaves: Any, conditions: Mapping[str, ConditionType]
    ) -> list[str]:
        """Return what keeps a program with these `leaves` from running the tree, with file and
        line.
        """

    async def run(
        self,
        tree: ProgramTree,
        leaves: Any,
        conditions: Mapping[str, ConditionType],
        task: TaskContext,
        report: Callable[[bytes], None],
    ) -> None:
        """Run the tree to its end.

        After each tick, `report` gets the statuses of its nodes in preorder. Raises TaskFailedError
        unless the tree succeeds.
        """

    async def run_file(
        self,
        path: Path,
        tree: str | None,
        leaves: Any,
        task: TaskContext,
        ports: Mapping[str, Any],
    ) -> None:
        """Run a tree of a file, with `ports` as its entries.

        Raises FileError, and TaskFailedError unless the tree succeeds.
        """


# A command of `mrbt`, or a group of commands; "tree.lift" is added to the group "tree".
COMMANDS: Group[click.Command] = Group("mrbt_mesh.commands", "command")
VIEWS: Group[Viewer] = Group("mrbt_mesh.views", "view")
# Texts that tell which losses of robots and capabilities a mission survives, by job type, or "".
ANALYSES: Group[Callable[[Mission], Mapping[str, str]]] = Group("mrbt_mesh.analyses", "analysis")
METRICS: Group[Metrics] = Group("mrbt_mesh.metrics", "kind of metrics")
PROGRAMS: Group[ProgramKind] = Group("mrbt_mesh.programs", "kind of robots")
# Named by the file's ending without the dot: "xml".
FILE_FORMATS: Group[TreeFormat] = Group("mrbt_mesh.file_formats", "file format")


def tree_format(file: str) -> TreeFormat:
    """Return the format of the trees in a file, by its ending. Raises InputError if unknown."""
    return FILE_FORMATS.load(file.rpartition(".")[2].lower())


def metrics() -> Metrics:
    """Return the installed kind of metrics. Raises InputError without one."""
    return METRICS.load("prometheus")
