"""The options that say where a page is served, and whether it may steer the team."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated

from mrbt_mesh.cli.framework.declare import Given, option
from mrbt_mesh.errors import InputError

if TYPE_CHECKING:
    from mrbt_mesh.views.web.server import PageOptions

PANEL = "The page"
EXTRA = "web"
# What the extra brings.
NEEDED = ("starlette", "uvicorn")


@dataclass(frozen=True)
class PageAddress:
    """Where the page is served."""

    port: Annotated[
        int, option("Port of the page. Default: a free one.", panel=PANEL, least=0, most=65535)
    ] = 0
    host: Annotated[
        str, option("Address of the page; others than loopback are open to all.", panel=PANEL)
    ] = "127.0.0.1"

    def page(self) -> PageOptions:
        """What the server is given; raises InputError without the extra, or for a busy port."""
        if not has_extra():
            raise InputError(f"the page needs more: pip install 'mrbt-mesh[{EXTRA}]'")
        from mrbt_mesh.views.web.server import PageOptions, bound

        options = PageOptions(self.host, self.port)
        # Before a team is started, or waited for.
        bound(options).close()
        return options


@dataclass(frozen=True)
class WebOptions(PageAddress):
    """Where, and what may be done there."""

    control: Annotated[
        bool, option("The page may also kill, freeze, pause and so on.", panel=PANEL)
    ] = False

    def page(self) -> PageOptions:
        """What the server is given; raises InputError without the extra."""
        return replace(super().page(), has_control=self.control)


# Foxglove's own, which its dialog proposes.
FOXGLOVE_PORT = 8765


@dataclass(frozen=True)
class FoxgloveOptions:
    """Whether Foxglove is served as well, and where."""

    foxglove: Annotated[
        bool, option("Serve Foxglove live as well, as docs/recording.md says.", panel=PANEL)
    ] = False
    foxglove_port: Annotated[
        int, option("Port for Foxglove; 0: a free one.", "PORT", panel=PANEL, least=0, most=65535)
    ] = FOXGLOVE_PORT

    def port(self, given: Given) -> int | None:
        """The port, None without Foxglove; raises InputError without the extra."""
        if not self.foxglove:
            given.refuse(("--foxglove-port",), "of Foxglove: give --foxglove as well")
            return None
        from mrbt_mesh.adapters.foxglove import require_extra

        require_extra()
        return self.foxglove_port


def has_extra() -> bool:
    """Whether the page can be served."""
    from importlib.util import find_spec

    return all(find_spec(name) is not None for name in NEEDED)
