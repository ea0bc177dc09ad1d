"""Options that installed plug-ins add to `watch`, `up` and `sim run`: views and exports."""

from __future__ import annotations

import functools
import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, TypeAlias
from urllib.parse import urlsplit

import click

from mrbt_mesh.cli.command import PATH, PORT, refuse, with_options
from mrbt_mesh.cli.options import chosen_robots
from mrbt_mesh.errors import InputError
from mrbt_mesh.plugins import ADAPTERS, VIEWS, Viewer, ViewerOptions

if TYPE_CHECKING:
    from mrbt_mesh.core.mission.mission import Mission
    from mrbt_mesh.core.observer.observer import Observer

# Is called whenever something may have changed, with the time on the observer's clock.
LookOn: TypeAlias = "Callable[[Observer, int], None]"


# What a proxy of this machine may be reached at.
_PUBLIC_URL = re.compile(r"https?://[A-Za-z0-9.\[\]:-]+(/[A-Za-z0-9._~/-]*)?")


class PublicUrl(click.ParamType[str]):
    """An address at which a proxy serves something, without a slash at its end."""

    name = "URL"

    def convert(self, value: str, _: Any, __: Any) -> str:
        """Raises click.BadParameter for what is none."""
        try:
            parts = urlsplit(value)
            is_address = bool(_PUBLIC_URL.fullmatch(value) and parts.hostname and parts.port != 0)
        except ValueError:  # a port or an address out of range
            is_address = False
        if not is_address:
            self.fail(f"{value!r}: an address is expected, e.g. https://robots.example/depot")
        return value.rstrip("/")


def public_url_option(what: str) -> Callable[..., Any]:
    """The option for the address at which a proxy serves `what`."""
    text = f"Address at which a proxy serves the {what}: https://..."
    return click.option("--public-url", type=PublicUrl(), metavar="URL", help=text)


# -- views ------------------------------------------------------------------------------------


@dataclass(frozen=True)
class ChosenViews:
    """The views that were asked for, by name."""

    viewers: Mapping[str, Viewer]
    options: ViewerOptions

    def check(self, mission: Mission | None = None) -> None:
        """Raise InputError, before a team is started, if a view cannot be opened, or if the robot
        to show is not of the mission that is to be run.
        """
        if not self.viewers:
            views = ", ".join(f"--{name}" for name in VIEWS.names())
            options = "--host", "--port", "--public-url", "--control", "--robot"
            refuse(f"for a view: give one of {views}", *options)
        for viewer in self.viewers.values():
            viewer.check(self.options)
        if mission is not None and self.options.robot is not None:
            chosen_robots("--robot", self.options.robot, mission)


def view_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """A flag for each installed view and its options, which the command gets as `views`."""
    names = VIEWS.names()

    @functools.wraps(function)
    def call(**values: Any) -> Any:
        chosen = {name: VIEWS.load(name) for name in names if values.pop(name.replace("-", "_"))}
        options = ViewerOptions(
            values.pop("host"),
            values.pop("port"),
            values.pop("control"),
            values.pop("robot"),
            public_url=values.pop("public_url") or "",
        )
        return function(**values, views=ChosenViews(chosen, options))

    flags = [
        *(click.option(f"--{name}", is_flag=True, help=VIEWS.load(name).summary) for name in names),
        click.option("--host", default="127.0.0.1", metavar="IP", help="Address of the view."),
        click.option(
            "--port", type=PORT, metavar="PORT", help="Port of the view. Default: its own, or any."
        ),
        public_url_option("view"),
        click.option("--control", is_flag=True, help="The view may also kill, freeze, pause, ..."),
        click.option("--robot", metavar="ID", help="Show the tree of this robot in the view."),
    ]
    return with_options(call, flags)


# -- files for other programs -----------------------------------------------------------------


def export_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """An option for each installed export; the command gets the files by name, as `exports`."""
    names = ADAPTERS.names()

    @functools.wraps(function)
    def call(**values: Any) -> Any:
        files = {name: values.pop(name.replace("-", "_")) for name in names}
        exports = {name: path for name, path in files.items() if path is not None}
        return function(**values, exports=exports)

    plugins = {name: ADAPTERS.load(name) for name in names}
    options = [
        click.option(f"--{name}", type=PATH, metavar=f"FILE{each.suffix}", help=each.summary)
        for name, each in plugins.items()
    ]
    return with_options(call, options)


def check_exports(exports: Mapping[str, Path]) -> None:
    """Raise InputError for files that cannot be written, or have another format's ending."""
    from mrbt_mesh.cli.terminal import check_outputs

    check_outputs(None, {f"--{name}": path for name, path in exports.items()})
    for name, path in exports.items():
        suffix = ADAPTERS.load(name).suffix
        if path.suffix != suffix:
            raise InputError(f"--{name} {path}: the name has to end in {suffix}")


@contextmanager
def exporting(
    exports: Mapping[str, Path], mission: Mission, began_us: int, began_unix_us: int
) -> Iterator[LookOn]:
    """Open the files; yields the function that writes to them.

    `began_us`: the time on the observer's clock that is the Unix time `began_unix_us`. Raises
    InputError for files that cannot be written.
    """
    with ExitStack() as stack:
        writers = []
        for name, path in exports.items():
            header, changes = ADAPTERS.load(name).start(mission, began_us, began_unix_us)
            file = stack.enter_context(_opened(path))
            _write(file, header)
            writers.append((file, changes))

        def look_on(observer: Observer, now_us: int) -> None:
            for file, changes in writers:
                _write(file, changes(observer, now_us))

        yield look_on


@contextmanager
def _opened(path: Path) -> Iterator[BinaryIO]:
    from mrbt_mesh.cli.terminal import reason

    try:
        # Unbuffered, so that nothing is lost however the process ends.
        file = path.open("wb", buffering=0)
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {reason(error)}") from None
    with file:
        yield file


def _write(file: BinaryIO, data: bytes) -> None:
    """Write it; a full disk ends the file, not the run."""
    from mrbt_mesh.cli.terminal import note, reason

    if file.closed or not data:
        return
    try:
        file.write(data)
    except OSError as error:
        note(f"{file.name}: ends here: {reason(error)}")
        file.close()
