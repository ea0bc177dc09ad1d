"""What BehaviorTree.CPP 4.10 really does, and what a team of one robot does in the same story.

The data was measured by running the library: tests/data/btcpp/README.md says how.
"""

from __future__ import annotations

import gzip
import json
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from typing import Any

from mrbt_mesh.analysis.team_tree import ALWAYS, TeamTree, to_team_tree
from mrbt_mesh.btcpp.files.check import check_library
from mrbt_mesh.btcpp.files.document import parse_document
from mrbt_mesh.btcpp.files.findings import Findings
from mrbt_mesh.btcpp.files.library import library_of
from mrbt_mesh.core.bt.evaluation import Request
from mrbt_mesh.core.bt.guards import conditions_in
from mrbt_mesh.core.bt.tree import NodeSpec, Status
from tests.support.build import World
from tests.support.paths import ROOT

DATA = ROOT / "tests" / "data" / "btcpp"

# What a tree shows after a step: the root's status, and which start of which action runs.
Shown = tuple[str, tuple[tuple[str, int], ...]]


@dataclass(frozen=True)
class Trace:
    """One tree, one story of conditions and actions, and what the library did."""

    id: str
    xml: str
    conditions: dict[str, str]
    actions: dict[str, list[list[int]]]
    shown: tuple[Shown, ...]
    error: str

    @property
    def family(self) -> str:
        return self.id.split("-")[0]

    def end(self, action: str, start: int, began: int, step: int) -> bool | None:
        """How a start of an action, in step `began`, has ended; None: it still runs."""
        ways = self.actions[action]
        delay, success = ways[(start - 1) % len(ways)]
        is_due = step % 2 == 1 and step > began and step >= began + delay
        return bool(success) if is_due else None


@cache
def traces() -> tuple[Trace, ...]:
    with gzip.open(DATA / "traces.jsonl.gz", "rt", encoding="utf-8") as lines:
        return tuple(_trace(json.loads(line)) for line in lines)


def _trace(row: dict[str, Any]) -> Trace:
    shown = tuple((status, tuple((name, n) for name, n in busy)) for status, busy in row["steps"])
    return Trace(row["id"], row["xml"], row["conditions"], row["actions"], shown, row["error"])


def team_tree(trace: Trace) -> TeamTree:
    """The tree as a team would carry it out, with notes; without a spec if it cannot."""
    models = [f'<Action ID="{name}"/>' for name in trace.actions]
    models += [f'<Condition ID="{name}"/>' for name in trace.conditions]
    text = (
        f'<root BTCPP_format="4"><BehaviorTree ID="Main">{trace.xml}</BehaviorTree>'
        f"<TreeNodesModel>{''.join(models)}</TreeNodesModel></root>"
    )
    findings = Findings()
    library = library_of(parse_document(text, "trace.xml"), findings)
    check_library(library, findings)
    assert not findings.errors, (trace.id, findings.errors)
    return to_team_tree(library, "Main", None)


def team_run(spec: NodeSpec, trace: Trace) -> tuple[Shown, ...]:
    """The same story, told in facts: what the team's tree shows in each step of it."""
    at_first = (name for name, values in trace.conditions.items() if values[0] == "1")
    world, known = World(spec, (*at_first, ALWAYS)), conditions_in(spec)

    def begin(step: int) -> None:
        for name, values in trace.conditions.items():
            if name in known:
                world.set(name, values[step] == "1")

    def finish(request: Request, _: int, success: bool) -> None:
        world.outcome(request.activation, success)

    count = len(next(iter(trace.conditions.values()), "0" * 30))
    return tuple(steps(world, count, begin, trace.end, finish))


def steps(
    world: World,
    count: int,
    begin: Callable[[int], None],
    end: Callable[[str, int, int, int], bool | None],
    finish: Callable[[Request, int, bool], Status | None],
) -> Iterator[Shown]:
    """What a tree shows in up to `count` steps: each begins with `begin(step)`.

    `end(action, start, began, step)`: how an action has ended; `finish` writes that, and returns
    the root's status in the tick of it, where that matters.
    """
    starts: Counter[str] = Counter()
    # Activation -> (which start of its action, the step in which it began).
    running: dict[str, tuple[int, int]] = {}

    def first_due(step: int) -> tuple[Request, int, bool] | None:
        """The first action in tree order that ends at this step, and how."""
        for request in world.tick().requests:
            if request.activation in running:
                start, began = running[request.activation]
                success = end(request.subject, start, began, step)
                if success is not None:
                    return request, start, success
        return None

    for step in range(count):
        begin(step)
        for gone in running.keys() - {request.activation for request in world.tick().requests}:
            del running[gone]  # halted
        while due := first_due(step):
            del running[due[0].activation]
            status = finish(*due)
            if status not in (None, Status.RUNNING):
                yield status.name, ()
                return
        asked = world.tick().requests
        for request in asked:
            if request.activation not in running:
                starts[request.subject] += 1
                running[request.activation] = (starts[request.subject], step)
        busy = sorted((request.subject, running[request.activation][0]) for request in asked)
        status = world.status
        yield status.name, tuple(busy) if status is Status.RUNNING else ()
        if status is not Status.RUNNING:
            return
