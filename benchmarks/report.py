"""How the benchmarks show their progress and write their tables."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn


def bar_of_jobs() -> Progress:
    """How many are done, on standard error."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
    return Progress(*columns, TimeElapsedColumn(), console=Console(stderr=True))


def grid(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """A Markdown table."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(map(str, line)) + " |" for line in lines)


def marks(name: str = "") -> tuple[str, str]:
    """What stands before and after what was measured, on a page where several things are."""
    what = f"measured {name}" if name else "measured"
    return f"<!-- {what}: begin -->", f"<!-- {what}: end -->"


def write_docs(path: Path, text: str, name: str = "") -> None:
    """Put what was measured between the marks of a page; raises ValueError if it has none."""
    page = path.read_text(encoding="utf-8")
    first, last = marks(name)
    before, begin, rest = page.partition(first)
    _, end, after = rest.partition(last)
    if not begin or not end:
        raise ValueError(f"{path} has no place for what was measured: {first} ... {last}")
    path.write_text(f"{before}{begin}\n\n{text}\n\n{end}{after}", encoding="utf-8")
