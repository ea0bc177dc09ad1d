"""What a benchmark is, what it returns, and which ones there are.

A benchmark of its own is a module with a constant `BENCHMARK: Benchmark`, named in MODULES. It
imports optional packages inside `run` only, through `need`, so that the others work without.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from types import ModuleType
from typing import Any, TypeAlias

Say: TypeAlias = Callable[[str], None]

EXTRA = "bench"


class MissingPackageError(Exception):
    """A benchmark needs a package that is not installed; the message says what to install."""


@dataclass(frozen=True)
class Setting:
    """How to run: `quick` for minutes in place of an hour, the first seed, where progress goes."""

    quick: bool
    seed: int
    say: Say


@dataclass(frozen=True)
class Table:
    """A table for people; the cells as they are to be printed.

    Raises ValueError if a row is not as long as the head.
    """

    title: str
    head: Sequence[str]
    rows: Sequence[Sequence[str]]

    def __post_init__(self) -> None:
        for row in self.rows:
            if len(row) != len(self.head):
                raise ValueError(f"{len(row)} cells under {len(self.head)} headings: {row}")


@dataclass(frozen=True)
class Chart:
    """Curves, from label to points. `name` is the stem of the file; axes with their units."""

    name: str
    title: str
    x_label: str
    y_label: str
    curves: Mapping[str, Sequence[tuple[float, float]]]
    log: bool = True


@dataclass(frozen=True)
class Result:
    """What a benchmark found.

    `reference` names what ratios are taken to, measured in the same run. `rows` are the figures
    for programs: names end in their unit. `notes` are sentences below the tables.
    """

    reference: str
    rows: Sequence[Mapping[str, Any]]
    tables: Sequence[Table]
    charts: Sequence[Chart] = field(default=())
    notes: Sequence[str] = field(default=())


@dataclass(frozen=True)
class Benchmark:
    """One benchmark; its name is that of its module."""

    summary: str
    run: Callable[[Setting], Result]


@dataclass(frozen=True)
class Script:
    """A program of its own: long, with options of its own, so not among the default ones.

    `options` are those of its usual and of its quick run. It writes its result to `--json FILE`.
    """

    summary: str
    options: Sequence[str]
    quick_options: Sequence[str]


MODULES = ("assignment", "evaluate", "plan", "loop", "auction")

SCRIPTS = {
    "failover": Script(
        "time from a kill or a freeze until the replacement has started",
        (),
        ("--kills", "3", "--freezes", "1"),
    ),
    "resume": Script("rounds of killing the whole team and resuming it", (), ("--rounds", "3")),
    "scale": Script(
        "teams of 6 to 64 processes: launch, cost at rest, time until a killed robot is replaced",
        (),
        ("--sizes", "6,12", "--kills", "2"),
    ),
    "membership": Script("false deaths, detection and agreement on bad networks", (), ()),
    "estimate": Script("how many runs mrbt sim estimate makes in a minute", (), ("--runs", "20")),
    "robustness": Script(
        "robots that die of their work, against published figures", (), ("--runs", "10")
    ),
}


def load(name: str) -> Benchmark:
    """The benchmark of a module."""
    found = importlib.import_module(f"benchmarks.{name}").BENCHMARK
    assert isinstance(found, Benchmark), f"benchmarks/{name}.py: BENCHMARK is no Benchmark"
    return found


def need(module: str) -> ModuleType:
    """Import a package of the extra `bench`; raises MissingPackageError."""
    try:
        return importlib.import_module(module)
    except ImportError:
        package = module.partition(".")[0]
        raise MissingPackageError(f"needs {package}: pip install -e '.[{EXTRA}]'") from None
