"""What benchmarks share: their command lines, work in processes, tables, pages of docs."""

from __future__ import annotations

import argparse
import inspect
import json
import os
import platform
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

from rich.console import Console
from rich.progress import track

from mrbt_mesh.sim.parallel import spread

ROOT = Path(__file__).resolve().parents[1]
CORES = os.cpu_count() or 1
# Options whose value is at least 1; that of others is at least 0.
COUNTS = ("jobs", "runs", "rounds", "robots", "messages", "beats")

_Key = TypeVar("_Key")
_Result = TypeVar("_Result")


def run_program(
    doc: str | None, measure: Callable[..., dict[str, Any]], page: Path | None = None
) -> dict[str, Any]:
    """Run a benchmark that is a program of its own; returns its figures.

    Its options are the parameters of `measure`. The figures go to stdout, and to `--json FILE`. Its
    `tables`, Markdown by their place on the `page`, are printed in place of the figures.
    """
    parser = argparse.ArgumentParser(
        description=doc, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="also write the figures here")
    if page is not None:
        parser.add_argument("--write-docs", action="store_true", help=f"update {page.name}")
    parameters = inspect.signature(measure).parameters
    for name, parameter in parameters.items():
        default: Any = parameter.default
        if isinstance(default, bool):
            parser.add_argument(f"--{name}", action="store_true")
            continue
        many = isinstance(default, tuple)
        kind = type(default[0] if many else default)
        shown = " ".join(map(str, default)) if many else default
        parser.add_argument(
            f"--{name}", type=kind, default=default, nargs="+" if many else None, help=f"({shown})"
        )
    options = vars(parser.parse_args())
    chosen = {name: options[name] for name in parameters}
    for name, value in chosen.items():
        if isinstance(value, int | float) and value < (name in COUNTS):
            parser.error(f"--{name}: a number from {int(name in COUNTS)} is expected, not {value}")
    load = os.getloadavg()[0]
    found = {"machine": machine(), "load_before": load, "options": chosen, **measure(**chosen)}
    tables: dict[str, str] = found.pop("tables", {})
    sys.stdout.write("\n\n".join(tables.values()) or json.dumps(found, indent=2))
    sys.stdout.write("\n")
    write_json(found, options["json"])
    if page is not None and options["write_docs"]:
        for name, text in tables.items():
            write_docs(page, text, name)
    return found


def machine() -> str:
    """What the figures were measured on."""
    system = f"{platform.system()}, Python {platform.python_version()}"
    return f"{os.cpu_count()} cores, {platform.machine()}, {system}"


def say(text: str) -> None:
    """A line of progress."""
    sys.stderr.write(text + "\n")
    sys.stderr.flush()


def write_json(result: Mapping[str, Any], file: Path | None) -> None:
    """Write the figures to a file if one is named."""
    if file is not None:
        file.write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")


def in_processes(
    calls: Sequence[tuple[_Key, Callable[[], _Result]]], processes: int
) -> Iterable[tuple[_Key, _Result]]:
    """Make the calls in processes, with a progress bar; results in the order of their ends."""
    results = spread(_call, calls, processes, chunk=1)
    return track(results, "", total=len(calls), console=Console(stderr=True))


def _call(named: tuple[_Key, Callable[[], _Result]]) -> tuple[_Key, _Result]:
    key, call = named
    return key, call()


def grid(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """A Markdown table."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(map(str, line)) + " |" for line in lines)


def marks(name: str = "") -> tuple[str, str]:
    """The lines before and after the tables of a benchmark on a page."""
    what = f"measured {name}" if name else "measured"
    return f"<!-- {what}: begin -->", f"<!-- {what}: end -->"


def write_docs(path: Path, text: str, name: str = "") -> None:
    """Replace what is between the marks of a page; raises ValueError if it has none."""
    page = path.read_text(encoding="utf-8")
    first, last = marks(name)
    before, begin, rest = page.partition(first)
    _, end, after = rest.partition(last)
    if not begin or not end:
        raise ValueError(f"{path} has no place for what was measured: {first} ... {last}")
    path.write_text(f"{before}{begin}\n\n{text}\n\n{end}{after}", encoding="utf-8")
