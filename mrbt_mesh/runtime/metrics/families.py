"""Metrics as plain data, in Prometheus' terms: families of samples, told apart by labels.

Names follow Prometheus' rules: `mrbt_` first, base units (seconds, bytes) last. A counter's name
stands here without `_total`, which is added where it is written.
"""

from __future__ import annotations

import enum
from bisect import bisect_left
from collections.abc import Iterable
from dataclasses import dataclass

# Upper bounds in seconds: from what is never noticed to what costs a robot its life.
DURATIONS_S = (0.0005, 0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 5.0, 10.0)


class FamilyKind(enum.StrEnum):
    """How a family's values are to be read. INFO: always 1, its labels say something."""

    GAUGE = "gauge"
    COUNTER = "counter"
    INFO = "info"
    HISTOGRAM = "histogram"


class Distribution:
    """How long something took, each time: how many did not take longer than each bound."""

    def __init__(self, bounds_s: tuple[float, ...] = DURATIONS_S) -> None:
        self.bounds_s = bounds_s
        self.counts = [0] * (len(bounds_s) + 1)
        self.sum_s = 0.0

    def observe(self, seconds: float) -> None:
        """It took so long once more."""
        self.counts[bisect_left(self.bounds_s, seconds)] += 1
        self.sum_s += seconds

    def buckets(self) -> list[tuple[str, float]]:
        """(upper bound, how many were not above it), the last bound `+Inf`."""
        found, so_far = [], 0
        names = (*map(repr, self.bounds_s), "+Inf")
        for name, count in zip(names, self.counts, strict=True):
            so_far += count
            found.append((name, float(so_far)))
        return found


Value = float | Distribution
Labels = tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Family:
    """One metric. `samples`: values by what `labels` are; only histograms have distributions."""

    kind: FamilyKind
    name: str
    help: str
    labels: Labels
    samples: tuple[tuple[Labels, Value], ...]


def single(kind: FamilyKind, name: str, text: str, value: Value) -> Family:
    """A family of one sample without labels."""
    return Family(kind, name, text, (), (((), value),))


def labelled(
    kind: FamilyKind, name: str, text: str, labels: Labels, samples: Iterable[tuple[Labels, float]]
) -> Family:
    """A family with labels, its samples in the order of these."""
    return Family(kind, name, text, labels, tuple(sorted(samples)))


def one_of(name: str, text: str, label: str, all_names: Iterable[str], holds: str) -> Family:
    """A gauge for each name, 1 for the one that holds and 0 for the others."""
    samples = tuple(((each,), float(each == holds)) for each in all_names)
    return Family(FamilyKind.GAUGE, name, text, (label,), samples)
