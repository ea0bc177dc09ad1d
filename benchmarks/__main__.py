"""Measure this project against what one would use instead.

    python -m benchmarks                        # those about the planner
    python -m benchmarks --list
    python -m benchmarks --only auction --quick --json bench.json --plot plots
    python -m benchmarks --only failover        # a long one, never run unless named

Every figure stands beside a reference measured in the same run: trust the ratios, not the
milliseconds. `--write-docs` puts the tables into docs/data/performance.md.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table as RichTable

from benchmarks.plots import draw
from benchmarks.registry import (
    MODULES,
    SCRIPTS,
    MissingPackageError,
    Result,
    Script,
    Setting,
    load,
)
from benchmarks.report import grid, marks, write_docs
from benchmarks.run import ROOT, machine, say, versions

DOCUMENT = ROOT / "docs" / "data" / "performance.md"
FORMAT = 1
WIDTH = 150  # of tables, where the terminal has fewer columns


def as_markdown(result: Result) -> str:
    """A result's tables and notes."""
    parts = []
    for table in result.tables:
        parts += [f"**{table.title}**", grid(table.head, table.rows)]
    parts += result.notes
    return "\n\n".join(parts)


def show(result: Result, console: Console) -> None:
    """A result's tables and notes on a terminal."""
    for table in result.tables:
        shown = RichTable(title=table.title, title_justify="left", box=None, padding=(0, 2, 0, 0))
        for index, name in enumerate(table.head):
            shown.add_column(name, justify="left" if index == 0 else "right", no_wrap=True)
        for row in table.rows:
            shown.add_row(*row)
        console.print(shown)
        console.print()
    for note in result.notes:
        console.print(note, highlight=False, markup=False)


def run_script(name: str, script: Script, quick: bool) -> dict[str, Any]:
    """Run a program of its own; returns its JSON. Raises CalledProcessError."""
    with tempfile.TemporaryDirectory(prefix="mrbt-bench-") as folder:
        file = Path(folder) / "result.json"
        command = [sys.executable, "-m", f"benchmarks.{name}"]
        command += [*(script.quick_options if quick else script.options), "--json", str(file)]
        subprocess.run(command, cwd=ROOT, check=True)
        found: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
        return found


def _listing() -> str:
    lines = [f"{name:12} {load(name).summary}" for name in MODULES]
    lines += ["", "long, run only when named:"]
    lines += [f"{name:12} {script.summary}" for name, script in SCRIPTS.items()]
    return "\n".join(lines)


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    assert __doc__ is not None
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    names = (*MODULES, *SCRIPTS)
    parser.add_argument("--list", action="store_true", help="what there is")
    parser.add_argument(
        "--only", action="append", choices=names, metavar="NAME", help="may be repeated"
    )
    parser.add_argument("--quick", action="store_true", help="small sizes, few seeds")
    parser.add_argument("--seed", type=int, default=1, help="the first seed (1)")
    parser.add_argument("--json", type=Path, metavar="FILE", help="also write all figures here")
    parser.add_argument("--plot", type=Path, metavar="DIR", help="also draw charts into here")
    parser.add_argument(
        "--write-docs",
        action="store_true",
        help="put the tables into docs/data/performance.md",
    )
    options = parser.parse_args(arguments)
    if options.json is not None and not options.json.resolve().parent.is_dir():
        parser.error(f"--json {options.json}: there is no such folder")
    if options.write_docs:  # now and not after an hour
        page = DOCUMENT.read_text(encoding="utf-8")
        for name in set(options.only or MODULES) - SCRIPTS.keys():
            if any(mark not in page for mark in marks(name)):
                parser.error(f"{DOCUMENT} has no place for {name}: {' ... '.join(marks(name))}")
    return options


def main(arguments: Sequence[str] | None = None) -> int:
    """Run benchmarks; returns the exit status: 2 if one lacks a package."""
    options = _options(arguments)
    if options.list:
        sys.stdout.write(_listing() + "\n")
        return 0
    report: dict[str, Any] = {
        "format": FORMAT,
        "machine": machine(),
        "versions": versions(),
        "load_before": os.getloadavg()[0],
        "seed": options.seed,
        "quick": options.quick,
        "results": {},
    }
    console = Console(width=max(Console().width, WIDTH))
    console.print(report["machine"], highlight=False)
    status = 0
    for name in options.only or MODULES:
        started_s = time.monotonic()
        say(f"{name} ...")
        try:
            report["results"][name] = found = _run(name, options, console)
        except MissingPackageError as error:
            say(f"{name}: {error}")
            status = 2
            continue
        found["seconds"] = round(time.monotonic() - started_s, 1)
        if options.json is not None:  # after each one: a long run that is ended keeps the rest
            options.json.write_text(json.dumps(report, indent=2) + "\n", encoding="utf-8")
    return status


def _run(name: str, options: argparse.Namespace, console: Console) -> dict[str, Any]:
    if name in SCRIPTS:
        return run_script(name, SCRIPTS[name], options.quick)
    result = load(name).run(Setting(options.quick, options.seed, say))
    show(result, console)
    if options.write_docs:
        write_docs(DOCUMENT, f"On {machine()}.\n\n{as_markdown(result)}", name)
    if options.plot is not None:
        for file in draw(result.charts, options.plot):
            say(f"{name}: {file}")
    return {"reference": result.reference, "rows": result.rows, "notes": result.notes}


if __name__ == "__main__":
    sys.exit(main())
