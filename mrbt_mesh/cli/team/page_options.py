"""The options that say where a page is served, and whether it may steer the team."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated

from mrbt_mesh.cli.framework.declare import option
from mrbt_mesh.errors import InputError

if TYPE_CHECKING:
    from mrbt_mesh.web.server import PageOptions

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
        """What the server is given; raises InputError without the extra."""
        if not has_extra():
            raise InputError(f"the page needs more: pip install 'mrbt-mesh[{EXTRA}]'")
        from mrbt_mesh.web.server import PageOptions

        return PageOptions(self.host, self.port)


@dataclass(frozen=True)
class WebOptions(PageAddress):
    """Where, and what may be done there."""

    control: Annotated[
        bool, option("The page may also kill, freeze, pause and so on.", panel=PANEL)
    ] = False

    def page(self) -> PageOptions:
        """What the server is given; raises InputError without the extra."""
        return replace(super().page(), has_control=self.control)


def has_extra() -> bool:
    """Whether the page can be served."""
    from importlib.util import find_spec

    return all(find_spec(name) is not None for name in NEEDED)
