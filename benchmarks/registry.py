"""What a benchmark of `python -m benchmarks` is, what it returns, and which ones there are.

Each is a module with a constant `BENCHMARK: Benchmark`, named in MODULES. It imports optional
packages inside `run` only, through `need`, so that the others work without.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from types import ModuleType
from typing import Any, TypeAlias

Say: TypeAlias = Callable[[str], None]

MODULES = ("assignment", "evaluate", "plan", "loop", "auction")


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
    """A table; the cells as they are to be printed.

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
class Result:
    """What a benchmark found.

    `reference` names what ratios are taken to, measured in the same run. `rows` are the figures
    for programs: names end in their unit. `notes` are sentences below the tables.
    """

    reference: str
    rows: Sequence[Mapping[str, Any]]
    tables: Sequence[Table]
    notes: Sequence[str] = field(default=())


@dataclass(frozen=True)
class Benchmark:
    """One benchmark; its name is that of its module."""

    summary: str
    run: Callable[[Setting], Result]


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
        raise MissingPackageError(f"needs {package}: pip install -e '.[bench]'") from None
