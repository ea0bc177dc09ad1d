"""Where a drill's robots run: on loopback, or in network namespaces that can be disturbed."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, Protocol

from mrbt_mesh.drills.drill_file import Drill
from mrbt_mesh.drills.namespaces import Namespaces, available, has_netem
from mrbt_mesh.runtime.run_dir import Place


class LinkFaults(Protocol):
    """Faults on links, separate for each direction; `loss_tool`: how packets are lost."""

    loss_tool: str

    def partition(self, *groups: Iterable[str]) -> None: ...
    def disturb(self, pairs: Iterable[tuple[str, str]], **changes: Any) -> None: ...
    def heal(self) -> None: ...


def why_not(drill: Drill) -> str | None:
    """Return why a drill cannot run on this machine, or None if it can."""
    if drill.model.network != "namespaces":
        return None
    reason = available()
    if reason is None and any(step.delay for step in drill.steps) and not has_netem():
        return "this kernel cannot delay packets: it lacks sch_netem"
    return reason


@contextmanager
def places(
    kind: str, robots: Sequence[str]
) -> Iterator[tuple[LinkFaults | None, dict[str, Place]]]:
    """Yield a drill's network and the place of each robot; None and nothing on loopback."""
    if kind != "namespaces":
        yield None, {}
        return
    with Namespaces(robots, "drill") as network:
        yield (
            network,
            {r: Place(network.address(r), tuple(network.command_prefix(r))) for r in robots},
        )
