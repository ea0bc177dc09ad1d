"""What benchmarks share: their options, work in several processes, tables, pages of docs."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

from rich.console import Console
from rich.progress import track

from mrbt_mesh.sim.parallel import spread

_Key = TypeVar("_Key")
_Result = TypeVar("_Result")


def script_parser(doc: str | None) -> argparse.ArgumentParser:
    """The options of a benchmark that is a program of its own; `doc` describes it."""
    parser = argparse.ArgumentParser(
        description=doc, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="also write the figures here")
    return parser


def page_parser(doc: str | None, page: Path) -> argparse.ArgumentParser:
    """The options of a benchmark whose tables are part of a page."""
    parser = script_parser(doc)
    parser.add_argument("--write-docs", action="store_true", help=f"update {page.name}")
    return parser


def positive(text: str) -> int:
    """The number of an option; raises ArgumentTypeError."""
    number = int(text)
    if number < 1:
        raise argparse.ArgumentTypeError(f"a number from 1 is expected, found {text}")
    return number


def write_json(result: Mapping[str, Any], file: Path | None) -> None:
    """Write the figures to a file if one is named."""
    if file is not None:
        file.write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")


def finish(text: str, result: Mapping[str, Any], page: Path, options: argparse.Namespace) -> None:
    """Print the tables; write the figures and update the page where the options say so."""
    sys.stdout.write(text + "\n")
    write_json(result, options.json)
    if options.write_docs:
        write_docs(page, text)


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
