"""The runs: every measurement on its networks, each as a call for a process of its own."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from functools import partial
from typing import Any

from benchmarks.membership.agreement import agreement, traffic
from benchmarks.membership.declarations import declarations
from benchmarks.membership.networks import BAD, BROKEN, GRADED, ROUGH, Net

# Kind, robots, network.
Key = tuple[str, int, Net]


def calls(full: bool) -> Iterator[tuple[Key, Callable[[], Any]]]:
    """Long ones first. Sizes: (robots, networks, seconds at rest, runs, victims)."""
    some = [Net(), Net(30), BAD, *(net for net in BROKEN if net.loss_percent)]
    sizes: list[tuple[int, Iterable[Net], int, int, int]] = [
        (128, (BAD,), 600, 5 if full else 1, 4),
        (64, (BAD, ROUGH), 600, 5 if full else 1, 4),
        (32, GRADED + BROKEN if full else [*some, ROUGH], 600, 5 if full else 1, 4),
        (16, (BAD,), 600, 20 if full else 1, 4),
        (6, GRADED + BROKEN, 600, 20 if full else 1, 2),
        (6, GRADED + BROKEN, 20, 50 if full else 12, 2),
        (3, GRADED + BROKEN, 600, 100 if full else 3, 1),
        (3, GRADED + BROKEN, 20, 200 if full else 40, 1),
        (2, GRADED, 600, 100 if full else 3, 1),
        (2, GRADED, 20, 200 if full else 40, 1),
    ]
    yield ("traffic", 64, Net()), partial(traffic, 64, Net(), 1)
    for robots, net, runs, events in (
        (32, BAD, 20 if full else 2, 18),
        (32, Net(), 5 if full else 1, 6),
        (6, BAD, 100 if full else 10, 18),
        (6, Net(), 10, 18),
    ):
        for seed in range(runs):
            yield ("agreement", robots, net), partial(agreement, robots, net, events, seed)
    for robots in (32, 6):
        for net in (Net(), BAD):
            yield ("traffic", robots, net), partial(traffic, robots, net, 1)
    for robots, nets, rest_s, runs, victims in sizes:
        for net in nets:
            for seed in range(1_000 * rest_s, 1_000 * rest_s + runs):
                run = partial(declarations, robots, net, rest_s, victims, seed)
                yield ("declarations", robots, net), run
