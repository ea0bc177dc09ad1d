"""A report as Markdown, for pull requests."""

from __future__ import annotations

import re
from collections.abc import Iterator

from mrbt_mesh.cli.views.report_tables import (
    WAIT_TITLES,
    Table,
    agreement_sentence,
    comparison_table,
    difference_table,
    failure_table,
    fault_table,
    plan_table,
    seconds,
    task_table,
    use_table,
    wait_table,
)
from mrbt_mesh.views.report.model import RunReport, RunsReport

_SPECIAL = re.compile(r"([\\`*_{}\[\]<>|#~&@])")


def report_markdown(report: RunsReport) -> str:
    """The whole document."""
    lines: list[str] = []
    if len(report.runs) > 1:
        lines += [f"# {len(report.runs)} runs", "", *_table(comparison_table(report.runs))]
    for each in report.campaigns:
        results = ", ".join(f"{count} {name}" for name, count in sorted(each.results.items()))
        lines += [f"# {_text(each.title)}", ""]
        lines += [f"{each.seeds} seeds in {each.took_s:.1f} s: {_text(results)}.", ""]
        for seed, texts in each.failures.items():
            lines += [f"- **seed {seed}**: {_text('; '.join(texts))}"]
        lines += ["" if each.failures else "No invariant broken.", ""]
        checks = tuple((name, f"{count:,}") for name, count in each.checks.items())
        lines += _table(Table(("invariant", "checks"), checks))
    for run in report.runs:
        lines += _run(run)
    return "\n".join(lines).rstrip() + "\n"


def _run(run: RunReport) -> Iterator[str]:
    yield from (f"# {_text(run.title)}: {_text(run.result)}", "")
    yield f"{_text(run.mission)}, {seconds(run.duration_s)}."
    yield from ("", *_table(comparison_table([run])))
    yield from (line for note in run.notes for line in (f"> {_text(note)}", ""))
    if run.expectations:
        yield from ("## Expected", "")
        for each in run.expectations:
            sign = "✔" if each.holds else "✘"
            yield f"- {sign} {_text(each.expected)}: {_text(each.found)}"
        yield ""
    sections = [
        ("Faults", fault_table(run)),
        ("Failures", failure_table(run)),
        ("Robots", use_table(run)),
    ]
    for kind, title in WAIT_TITLES.items():
        sections.append((title, wait_table(run, kind)))
    for title, table in [*sections, ("Global tasks", task_table(run))]:
        if table.rows:
            yield from (f"## {title}", "", *_table(table))
    if run.differences is not None:
        yield from ("## Agreement", "", _text(agreement_sentence(run)), "")
        for table in (plan_table(run), difference_table(run)):
            if table.rows:
                yield from _table(table)


def _table(table: Table) -> list[str]:
    rows = [table.head, tuple("---" for _ in table.head), *table.rows]
    lines = [f"| {' | '.join(map(_cell, row))} |" for row in rows]
    return [*lines, "", *([_text(table.note), ""] if table.note else [])]


def _cell(text: str) -> str:
    return text if text == "---" else _text(text)


def _text(text: str) -> str:
    """Names come from files: they are shown as they are, and mean nothing to Markdown."""
    return _SPECIAL.sub(r"\\\1", " ".join(text.split()))
