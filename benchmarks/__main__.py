"""Measure this project's planning against what one would use instead.

    python -m benchmarks
    python -m benchmarks --list
    python -m benchmarks --only auction --quick --json bench.json

Every figure is measured beside a reference in the same run: trust the ratios, not the
milliseconds. `--write-docs` puts the tables into docs/data/performance.md. The benchmarks of whole
teams are programs of their own: see the targets `bench-*` of make.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from benchmarks.registry import MODULES, MissingPackageError, Result, Setting, load
from benchmarks.report import ROOT, grid, machine, marks, say, write_docs, write_json

DOCUMENT = ROOT / "docs" / "data" / "performance.md"
FORMAT = 1


def as_markdown(result: Result) -> str:
    """A result's tables and notes."""
    parts = []
    for table in result.tables:
        parts += [f"**{table.title}**", grid(table.head, table.rows)]
    return "\n\n".join([*parts, *result.notes])


def versions() -> dict[str, str]:
    """Version of each package that figures depend on, of those that are installed."""
    found = {}
    for package in ("ortools", "numpy", "scipy", "py_trees"):
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            continue
    return found


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--list", action="store_true", help="list the benchmarks")
    parser.add_argument(
        "--only", action="append", choices=MODULES, metavar="NAME", help="may be repeated"
    )
    parser.add_argument("--quick", action="store_true", help="small sizes, few seeds")
    parser.add_argument("--seed", type=int, default=1, help="the first seed (1)")
    parser.add_argument("--json", type=Path, metavar="FILE", help="also write all figures here")
    parser.add_argument("--write-docs", action="store_true", help=f"update {DOCUMENT.name}")
    options = parser.parse_args(arguments)
    if options.json is not None and not options.json.resolve().parent.is_dir():
        parser.error(f"--json {options.json}: there is no such folder")
    if options.write_docs:  # now and not after an hour
        page = DOCUMENT.read_text(encoding="utf-8")
        for name in options.only or MODULES:
            if any(mark not in page for mark in marks(name)):
                parser.error(f"{DOCUMENT} has no place for {name}: {' ... '.join(marks(name))}")
    return options


def main(arguments: Sequence[str] | None = None) -> int:
    """Run benchmarks; returns the exit status: 2 if one lacks a package."""
    options = _options(arguments)
    if options.list:
        sys.stdout.writelines(f"{name:12} {load(name).summary}\n" for name in MODULES)
        return 0
    results: dict[str, Any] = {}
    report = {
        "format": FORMAT,
        "machine": machine(),
        "versions": versions(),
        "load_before": os.getloadavg()[0],
        "seed": options.seed,
        "quick": options.quick,
        "results": results,
    }
    status = 0
    for name in options.only or MODULES:
        started_s = time.monotonic()
        say(f"{name} ...")
        try:
            result = load(name).run(Setting(options.quick, options.seed, say))
        except MissingPackageError as error:
            say(f"{name}: {error}")
            status = 2
            continue
        text = f"On {machine()}.\n\n{as_markdown(result)}"
        sys.stdout.write(f"{text}\n\n")
        if options.write_docs:
            write_docs(DOCUMENT, text, name)
        results[name] = {
            "reference": result.reference,
            "rows": result.rows,
            "notes": result.notes,
            "seconds": round(time.monotonic() - started_s, 1),
        }
        write_json(report, options.json)  # after each: a long run that is ended keeps the rest
    return status


if __name__ == "__main__":
    sys.exit(main())
