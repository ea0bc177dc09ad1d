"""What one who watches a team passes on of it to other programs, while it watches."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from functools import partial
from typing import TYPE_CHECKING, TypeAlias

if TYPE_CHECKING:
    from mrbt_mesh.runtime.metrics.server import MetricsAddress
    from mrbt_mesh.runtime.watcher import Watcher

# Open while the team is watched.
Share: TypeAlias = "Callable[[Watcher], AbstractContextManager[object]]"


def shares_nothing(watcher: Watcher) -> AbstractContextManager[None]:
    """Nothing is passed on."""
    return nullcontext()


@contextmanager
def team_metrics(address: MetricsAddress | None, watcher: Watcher) -> Iterator[None]:
    """Serve metrics of the whole team; None: serve none. Raises InputError if that cannot be."""
    if address is None:
        yield
        return
    from mrbt_mesh.runtime.metrics.server import metrics_app, read_in_loop, serving
    from mrbt_mesh.runtime.metrics.team_page import team_page

    page = partial(team_page, watcher.observer)
    with serving(address, metrics_app(partial(read_in_loop, asyncio.get_running_loop(), page))):
        yield
