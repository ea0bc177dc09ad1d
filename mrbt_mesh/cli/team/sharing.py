"""What one who watches a team passes on of it to other programs, while it watches."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext
from typing import TYPE_CHECKING, TypeAlias

from mrbt_mesh import plugins
from mrbt_mesh.cli.exporting import ExportOptions, LookOn

if TYPE_CHECKING:
    from mrbt_mesh.core.observer.observer import Observer
    from mrbt_mesh.plugins import MetricsAddress
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
            stack.enter_context(plugins.metrics().serving_team(watcher.observer, metrics))
        now_us, unix_us = boottime_us(), time.time_ns() // 1_000
        mission = watcher.observer.mission
        yield stack.enter_context(export.writing(mission, now_us, unix_us))
