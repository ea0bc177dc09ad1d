"""What one who watches a team passes on of it to other programs, while it watches."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext
from functools import partial
from typing import TYPE_CHECKING, TypeAlias

from mrbt_mesh.cli.exporting import ExportOptions, LookOn

if TYPE_CHECKING:
    from mrbt_mesh.core.observer.observer import Observer
    from mrbt_mesh.runtime.metrics.server import MetricsAddress
    from mrbt_mesh.runtime.watcher import Watcher

# Open while the team is watched; what it yields is shown all that is seen.
Share: TypeAlias = "Callable[[Watcher], AbstractContextManager[LookOn]]"


def shares_nothing(watcher: Watcher) -> AbstractContextManager[LookOn]:
    """Nothing is passed on."""

    def look_on(observer: Observer, now_us: int) -> None:
        pass

    return nullcontext(look_on)


@contextmanager
def sharing(
    metrics: MetricsAddress | None, export: ExportOptions, watcher: Watcher
) -> Iterator[LookOn]:
    """Serve metrics of the whole team (None: serve none), and write files for other programs.

    Raises InputError for what cannot be served or written.
    """
    from mrbt_mesh.runtime.fencing import boottime_us

    with ExitStack() as stack:
        if metrics is not None:
            stack.enter_context(_serving(metrics, watcher))
        now_us, unix_us = boottime_us(), time.time_ns() // 1_000
        mission = watcher.observer.mission
        yield stack.enter_context(export.writing(mission, now_us, unix_us))


def _serving(address: MetricsAddress, watcher: Watcher) -> AbstractContextManager[int]:
    from mrbt_mesh.runtime.metrics.server import metrics_app, read_in_loop, serving
    from mrbt_mesh.runtime.metrics.team_page import team_page

    page = partial(team_page, watcher.observer)
    return serving(address, metrics_app(partial(read_in_loop, asyncio.get_running_loop(), page)))
