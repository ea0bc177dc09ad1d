"""Metrics as plain data, in Prometheus' terms: families of samples with labels.

Names follow Prometheus' rules: they begin with `mrbt_` and end with a base unit (seconds, bytes). A
counter's name has no `_total`, which the server adds. Labels are names from the mission file and
constants: the number of labels must stay small, but texts of refusals contain arbitrary input.
"""

from __future__ import annotations

import enum
import re
from bisect import bisect_left
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import partial

from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.core.mission.names import type_name

# The label for names that the mission does not have.
OTHER = "other"
# Upper bounds in seconds: from unnoticeable delays to those for which a robot is declared dead.
DURATIONS_S = (0.0005, 0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 5.0, 10.0)


class FamilyKind(enum.StrEnum):
    """The type of a family's values. INFO: always 1; its labels carry the information."""

    GAUGE = "gauge"
    COUNTER = "counter"
    INFO = "info"
    HISTOGRAM = "histogram"


class Distribution:
    """A histogram of durations, counted by upper bound."""

    def __init__(self, bounds_s: tuple[float, ...] = DURATIONS_S) -> None:
        self.bounds_s = bounds_s
        self.counts = [0] * (len(bounds_s) + 1)
        self.sum_s = 0.0

    def observe(self, seconds: float) -> None:
        """Count one duration."""
        self.counts[bisect_left(self.bounds_s, seconds)] += 1
        self.sum_s += seconds

    def buckets(self) -> list[tuple[str, float]]:
        """Return pairs of an upper bound and the number of durations up to it; last is `+Inf`."""
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
    """One metric. `samples`: (values of `labels`, value); only histograms have distributions."""

    kind: FamilyKind
    name: str
    help: str
    labels: Labels
    samples: tuple[tuple[Labels, Value], ...]


def family(
    kind: FamilyKind,
    name: str,
    text: str,
    value: Value | Mapping[Labels, float],
    *labels: str,
) -> Family:
    """Make a family of one sample, or of a mapping from label values to values, sorted."""
    samples = tuple(sorted(value.items())) if isinstance(value, Mapping) else (((), value),)
    return Family(kind, name, text, labels, samples)


gauge, counter, histogram = (
    partial(family, kind) for kind in (FamilyKind.GAUGE, FamilyKind.COUNTER, FamilyKind.HISTOGRAM)
)


def by_name(counts: Mapping[str, float], names: Iterable[str] | None = None) -> dict[Labels, float]:
    """Return samples with one label; a name of `names` without a count has the value 0."""
    return {(name,): float(counts.get(name, 0)) for name in (counts if names is None else names)}


def robot_label(mission: Mission, name: str) -> str:
    """Return a robot's name if the mission lists it, else OTHER."""
    return name if name in mission.robots else OTHER


def task_label(mission: Mission, local_task: str) -> str:
    """Return the type of a local task if the mission has it, else OTHER."""
    name = type_name(local_task)
    return name if name in mission.local_tasks else OTHER


# Classes of refusals; the first match counts, and a reason that matches none is malformed.
_CLASSES = (
    ("flood", r"too much to check"),
    ("replayed", r"said before"),
    ("late", r"^late: "),
    ("stale", r"^a life of \w+ from before|meant for an earlier life"),
    ("misdirected", r"meant for somebody else|not meant for this member"),
    ("unsigned", r"^not signed$"),
    ("forged", r"signature is wrong|has no key|under the (name|key) of|may not say this"),
    ("forged", r"not signed by its author|another author"),
    ("incompatible", r"^(run|mission) '|wire schema|^signed: this team"),
)
MALFORMED = "malformed"
REASONS = (*dict.fromkeys(name for name, _ in _CLASSES), MALFORMED)


def reason_class(reason: str) -> str:
    """Return the class of a refusal, one of `REASONS`."""
    return next((name for name, text in _CLASSES if re.search(text, reason)), MALFORMED)


def refusals_by_class(mission: Mission, refused: Mapping[str, int]) -> Counter[Labels]:
    """Count refused messages by (source, class), from `AgentView.refused`."""
    found: Counter[Labels] = Counter()
    for text, count in refused.items():
        source, _, reason = text.partition(": ")
        found[robot_label(mission, source), reason_class(reason) if reason else OTHER] += count
    return found
