"""A report as one HTML file that needs nothing else: no scripts, no fonts, no network."""

from __future__ import annotations

from html import escape

from mrbt_mesh.cli.views.report_gantt import HUES, gantt, kinds
from mrbt_mesh.cli.views.report_style import STYLE
from mrbt_mesh.cli.views.report_tables import (
    WAIT_TITLES,
    Table,
    agreement_sentence,
    agreement_text,
    comparison_table,
    difference_table,
    failure_table,
    fault_table,
    percent,
    plan_table,
    seconds,
    spread_text,
    task_table,
    use_table,
    wait_table,
)
from mrbt_mesh.views.report.model import CampaignReport, RunReport, RunsReport

GOOD, BAD = ("success", "green"), ("failure", "red")
LONG = ("why", "who could", "found")
NONE_BROKEN = "no invariant broken"
# So many letters need a wide column, where it is scrolled sideways.
LONGEST = 100
SIGNS = {"success": "✔", "green": "✔", "failure": "✘", "red": "✘"}


def report_html(report: RunsReport) -> str:
    """The whole page."""
    titles = [run.title for run in report.runs] + [each.title for each in report.campaigns]
    title = titles[0] if len(titles) == 1 else f"{len(titles)} reports"
    parts = []
    if len(report.runs) > 1:
        parts.append(_comparison(report.runs))
    parts += [_campaign(each) for each in report.campaigns]
    parts += [_run(run) for run in report.runs]
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{escape(title)}: report</title>\n<style>\n{STYLE}</style></head>\n"
        f"<body><main>\n{''.join(parts)}\n</main></body></html>\n"
    )


def _comparison(runs: tuple[RunReport, ...]) -> str:
    longest_s = max(run.duration_s for run in runs) or 1.0
    bars = {(n, 3): run.duration_s / longest_s for n, run in enumerate(runs)}
    return f'<header class="run"><h1>{len(runs)} runs</h1></header>' + _section(
        "Comparison", _table(comparison_table(runs), bars)
    )


def _run(run: RunReport) -> str:
    about = "" if run.title == run.mission else f'<span class="soft">{escape(run.mission)}</span>'
    verdict = "" if run.verdict in (None, run.result) else _chip(run.verdict or "")
    head = (
        f'<header class="run"><h1>{escape(run.title)}</h1>{about}'
        f"{_chip(run.result)}{verdict}</header>"
    )
    notes = "".join(f'<p class="soft">Note: {escape(note)}.</p>' for note in run.notes)
    return "\n".join(
        part
        for part in (
            head,
            notes,
            _cards(run),
            _expectations(run),
            _section("Who did what when", _chart(run)),
            _section("Faults", _table(fault_table(run))) if run.faults else "",
            _section("Failures", _table(failure_table(run))) if run.failures else "",
            _pair(
                _section("Robots", _table(use_table(run), _meters(run))) if run.robots else "",
                _section("Global tasks", _table(task_table(run))) if run.tasks else "",
            ),
            _section("What waited for whom", _waits(run)),
            _section("Agreement", _agreement(run)),
        )
        if part
    )


def _cards(run: RunReport) -> str:
    held = [fault for fault in run.deaths if fault.held]
    taken = [fault for fault in held if fault.replacement]
    cards = [(seconds(run.duration_s), "from the first robot's joining to the result")]
    died = len(run.deaths)
    lost = len(run.faults) - died
    cards.append((f"{died} + {lost}", "deaths (major faults) and losses of capabilities (minor)"))
    if died:
        cards.append((spread_text(f.detected_ms for f in run.deaths), "until a death was detected"))
        known = spread_text(fault.taken_over_ms for fault in taken)
        cards.append((known, f"until its task ran again: {len(taken)} of {len(held)} taken over"))
    if run.work is not None:
        cards.append((percent(run.utilisation), "utilisation of the robots while they lived"))
    if run.differences is not None:
        cards.append((agreement_text(run), "of the time all robots reported the same plan"))
    listed = "".join(
        f'<div class="card"><b>{escape(value)}</b><i>{escape(text)}</i></div>'
        for value, text in cards
    )
    return f'<div class="cards">{listed}</div>'


def _chart(run: RunReport) -> str:
    chart = gantt(run)
    if not chart:
        return ""
    keys = [(f"h{n % HUES}", kind) for n, kind in enumerate(kinds(run))]
    keys += [("starting", "claimed, not started")]
    if run.deaths:
        keys += [("away", "dead"), ("takeover", "taken over (arrow)")]
    legend = "".join(
        f'<span><span class="key {name}"></span>{escape(text)}</span>' for name, text in keys
    )
    signs = "<span>✝ died ✘ failed ↷ given up"
    signs += " ▲ lost a capability</span>" if any(f.lost for f in run.faults) else "</span>"
    return f'{_wide(chart, "Gantt chart")}<div class="legend">{legend}{signs}</div>'


def _meters(run: RunReport) -> dict[tuple[int, int], float]:
    if run.work is None:
        return {}
    return {(n, 3): robot.utilisation or 0.0 for n, robot in enumerate(run.robots)}


def _waits(run: RunReport) -> str:
    if run.waits is None:
        return ""
    parts = []
    for kind, title in WAIT_TITLES.items():
        table = wait_table(run, kind)
        if table.rows or table.note:
            total = seconds(run.waited_s(kind))
            parts.append(f"<h3>{escape(title)}: {total} together</h3>{_table(table)}")
    return "".join(parts) or '<p class="soft">Nothing waited.</p>'


def _agreement(run: RunReport) -> str:
    if run.differences is None:
        return ""
    parts = [f"<p>{escape(agreement_sentence(run))}</p>"]
    for title, table in (
        ("Plans on which the team agreed last", plan_table(run)),
        ("Longest times with different plans", difference_table(run)),
    ):
        if table.rows:
            parts.append(f"<h3>{escape(title)}</h3>{_table(table)}")
    return "".join(parts)


def _expectations(run: RunReport) -> str:
    if not run.expectations:
        return ""
    rows = "".join(
        f'<tr><td class="{"good" if e.holds else "bad"}">{"✔" if e.holds else "✘"}</td>'
        f'<td>{escape(e.expected)}</td><td class="long">{escape(e.found)}</td></tr>'
        for e in run.expectations
    )
    head = "<tr><th></th><th>expected</th><th>found</th></tr>"
    return _section("What the drill expected", _wide(f"<table>{head}{rows}</table>", "Expected"))


def _campaign(each: CampaignReport) -> str:
    failed = len(each.failures)
    word = f"{failed} {'seed' if failed == 1 else 'seeds'} failed" if failed else NONE_BROKEN
    kind = "bad" if failed else "good"
    head = (
        f'<header class="run"><h1>{escape(each.title)}</h1>'
        f'<span class="chip {kind}">{"✘" if failed else "✔"} {word}</span></header>'
    )
    results = ", ".join(f"{count} {name}" for name, count in sorted(each.results.items()))
    text = f"<p>{each.seeds} seeds in {each.took_s:.1f} s: {escape(results)}.</p>"
    checks = Table(
        ("invariant", "checks"), tuple((n, f"{count:,}") for n, count in each.checks.items())
    )
    broken = Table(
        ("seed", "found"),
        tuple((str(seed), text) for seed, texts in each.failures.items() for text in texts),
    )
    section = _section("Checks", _table(checks))
    return head + text + (_section("Broken", _table(broken)) if failed else "") + section


def _chip(word: str) -> str:
    kind = "good" if word in GOOD else "bad" if word in BAD else ""
    sign = SIGNS.get(word, "…")
    return f'<span class="chip {kind}">{sign} {escape(word)}</span>'


def _section(title: str, body: str) -> str:
    return f"<section><h2>{escape(title)}</h2>{body}</section>" if body else ""


def _pair(first: str, second: str) -> str:
    """Side by side where there is room."""
    return f'<div class="pair">{first}{second}</div>' if first and second else first or second


def _table(table: Table, bars: dict[tuple[int, int], float] | None = None) -> str:
    """`bars`: (row, column) -> a share to be drawn before the text."""
    head = "".join(f"<th>{escape(name)}</th>" for name in table.head)
    rows = []
    for n, row in enumerate(table.rows):
        cells = []
        for column, text in enumerate(row):
            name, bar = table.head[column], (bars or {}).get((n, column))
            width = "longest" if len(text) > LONGEST else "long"
            kind = f' class="{width}"' if name in LONG else ' class="n"' if len(text) < 16 else ""
            meter = (
                ""
                if bar is None
                else f'<span class="meter"><i style="width:{100 * bar:.1f}%"></i></span>'
            )
            cells.append(f"<td{kind}>{meter}{escape(text)}</td>")
        rows.append(f"<tr>{''.join(cells)}</tr>")
    note = f'<p class="soft">{escape(table.note)}</p>' if table.note else ""
    if not rows:
        return note
    return _wide(f"<table><tr>{head}</tr>{''.join(rows)}</table>", table.head[-1]) + note


def _wide(body: str, name: str) -> str:
    """May be scrolled sideways, also by keyboard."""
    return f'<div class="wide" tabindex="0" role="group" aria-label="{escape(name)}">{body}</div>'
