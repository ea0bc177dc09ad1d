"""An analysis as one HTML file that needs nothing else: no scripts, no fonts, no network."""

from __future__ import annotations

from collections.abc import Iterable
from html import escape

from mrbt_mesh.analysis.tolerance.analyse import Analysis, assumptions
from mrbt_mesh.analysis.tolerance.fault_counts import Tolerance
from mrbt_mesh.cli.views.analyze_view import (
    READING_NAMES,
    advice_rows,
    faults_text,
    figure,
    task_groups,
)
from mrbt_mesh.core.facts.coalitions import majority
from mrbt_mesh.core.mission.costs import Costs
from mrbt_mesh.core.mission.names import type_name

MAX_MATRIX_COLUMNS = 40
_STYLE = """
:root { --good: #1a7f37; --bad: #cf222e; --line: #d8dee4; --soft: #57606a; --ground: #f6f8fa; }
* { box-sizing: border-box; }
body { font: 15px/1.5 system-ui, sans-serif; color: #1f2328; margin: 0 auto; padding: 2rem;
       max-width: 68rem; }
h1 { font-size: 1.7rem; margin: 0; } h2 { font-size: 1.15rem; margin: 2.2rem 0 .5rem; }
p { margin: .4rem 0; } .soft { color: var(--soft); }
.good { color: var(--good); font-weight: 600; } .bad { color: var(--bad); font-weight: 600; }
.cards { display: flex; flex-wrap: wrap; gap: .8rem; margin-top: 1.2rem; }
.card { border: 1px solid var(--line); border-radius: .5rem; padding: .8rem 1.1rem;
  flex: 1 1 12rem; }
.card b { display: block; font-size: 1.7rem; line-height: 1.2; }
.card i { font-style: normal; color: var(--soft); font-size: .85rem; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; } td, th { padding: .3rem .9rem .3rem 0; text-align: left;
  border-bottom: 1px solid var(--line); vertical-align: top; }
th { font-weight: 600; color: var(--soft); font-size: .85rem; } td.n, th.n { text-align: right; }
.bar { display: inline-block; height: .75rem; width: 14rem; background: var(--ground);
  border-radius: .4rem; overflow: hidden; vertical-align: middle; }
.bar span { display: block; height: 100%; background: #4ac26b; }
table.matrix td { text-align: center; padding: .15rem .5rem; }
table.matrix td.r { text-align: left; font-weight: 600; }
table.matrix td.has { background: #dafbe1; } table.matrix td.critical { background: #ffcecb; }
table.matrix td.dead { color: var(--bad); }
""".strip()


def _cells(cells: Iterable[str], tag: str = "td") -> str:
    return "<tr>" + "".join(f"<{tag}>{cell}</{tag}>" for cell in cells) + "</tr>"


def _table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    body = "\n".join(_cells(row) for row in rows)
    heading = _cells(map(escape, head), "th")
    return f'<div class="wide"><table>\n{heading}\n{body}\n</table></div>'


def _yes(value: bool | None) -> str:
    if value is None:
        return "not known"
    return '<span class="good">yes</span>' if value else '<span class="bad">no</span>'


def html_report(analysis: Analysis, costs: Costs) -> str:
    """The whole page."""
    name = escape(analysis.mission.name)
    sections = [
        _head(analysis),
        _figures(analysis),
        _which(analysis),
        _matrix(analysis),
        _tasks(analysis),
        _advice(analysis, costs),
        _cautions(analysis),
        "<h2>Assumed</h2><ul class='soft'>"
        + "".join(f"<li>{escape(line)}</li>" for line in assumptions(analysis.mission))
        + "</ul>",
    ]
    body = "\n".join(sections)
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{name}: fault tolerance</title>\n<style>\n{_STYLE}\n</style></head>\n"
        f"<body>\n{body}\n</body></html>\n"
    )


def _head(analysis: Analysis) -> str:
    main = analysis.main

    obstacles = "".join(
        f'<p class="bad">{escape(READING_NAMES[name])}: {escape(result.question.obstacle)}</p>'
        for name, result in analysis.readings.items()
        if result.question.obstacle
    )
    late = (
        "" if analysis.is_complete else "<p class='bad'>Time ran out; ranges hold the figures.</p>"
    )
    cards = (
        _card(_yes(main.is_weak), "weakly fault tolerant: survives the loss of any one capability"),
        _card(_yes(main.is_strong), "strongly fault tolerant: survives the loss of any one robot"),
        _card_of(main.major, "robots"),
        _card_of(main.minor, "capabilities"),
    )
    return (
        f"<h1>{escape(analysis.mission.name)}</h1><p class='soft'>which faults it survives</p>"
        f'<div class="cards">{"".join(cards)}</div>{obstacles}{late}'
    )


def _card(value: str, text: str) -> str:
    return f'<div class="card"><b>{value}</b><i>{escape(text)}</i></div>'


def _card_of(kind: Tolerance, what: str) -> str:
    fatal = figure(kind.min_fatal, False)
    text = f"of {kind.total} {what} can be lost at best; the fewest that are fatal: {fatal}"
    return _card(figure(kind.max_tolerated, True), text)


def _figures(analysis: Analysis) -> str:
    rows = []
    for name, result in analysis.readings.items():
        for kind, found in (("robots", result.major), ("capabilities", result.minor)):
            share = 100 * (found.max_tolerated.value or 0) // max(1, found.total)
            bar = f'<span class="bar"><span style="width:{share}%"></span></span>'
            survived = f"{bar} {figure(found.max_tolerated, True)} of {found.total}"
            fatal = f'<span class="bad">{figure(found.min_fatal, False)}</span>'
            first = escape(READING_NAMES[name]) if kind == "robots" else ""
            rows.append((first, kind, survived, fatal))
    return "<h2>How many faults</h2>" + _table(
        ("the mission ...", "faults", "survives up to", "fatal from"), rows
    )


def _which(analysis: Analysis) -> str:
    major, minor = analysis.main.major, analysis.main.minor
    named = (
        ("fatal alone", major.critical, minor.critical),
        ("fatal together, fewest", major.min_fatal.chosen, minor.min_fatal.chosen),
        ("survived together, most", major.max_tolerated.chosen, minor.max_tolerated.chosen),
    )
    rows = [
        (
            name,
            escape(faults_text(robots)),
            escape(faults_text(entries, "\n")).replace("\n", "<br>"),
        )
        for name, robots, entries in named
    ]
    return "<h2>Which faults</h2>" + _table(("", "robots", "capabilities"), rows)


def _matrix(analysis: Analysis) -> str:
    """Robots and what they can do; what is fatal alone stands out."""
    robots = analysis.mission.robots
    columns = sorted({name for robot in robots.values() for name in robot.capabilities})
    if len(columns) > MAX_MATRIX_COLUMNS:
        return ""
    critical, dead = set(analysis.main.minor.critical), set(analysis.main.major.critical)
    rows = []
    for robot in sorted(robots):
        first = "r dead" if robot in dead else "r"
        cells = [f'<td class="{first}">{escape(robot)}</td>']
        for name in columns:
            has = name in robots[robot].capabilities
            kind = "critical" if (robot, name) in critical else "has" if has else ""
            cells.append(f'<td class="{kind}">{"&#9679;" if has else ""}</td>')
        rows.append(f"<tr>{''.join(cells)}</tr>")
    head = _cells(["", *map(escape, columns)], "th")
    return (
        "<h2>The team</h2><p class='soft'>Red: its loss alone is fatal.</p>"
        f'<div class="wide"><table class="matrix">{head}{"".join(rows)}</table></div>'
    )


def _tasks(analysis: Analysis) -> str:
    robots = analysis.mission.robots
    rows = []
    for name, each in sorted(task_groups(analysis.tasks), key=lambda row: row[1].slack):
        needs = ", ".join(f"{least} of {able} {what}" for what, least, able in each.needs)
        notes = [] if each.is_indispensable else ["has alternatives"]
        if each.is_exclusive:
            notes.append(f"exclusive: {majority(robots)} of {len(robots)} robots grant it")
        style = "bad" if each.slack <= 0 else "good"
        slack = f'<span class="{style}">{each.slack}</span>'
        rows.append((escape(name), slack, escape(needs), escape(", ".join(notes))))
    return (
        "<h2>Slack</h2><p class='soft'>How many robots a global task can lose, "
        "whichever they are.</p>"
        + _table(("global task", "slack", "needs (of capable robots)", ""), rows)
    )


def _cautions(analysis: Analysis) -> str:
    listed = "".join(f"<li>{escape(line)}</li>" for line in analysis.cautions)
    return f"<h2>Cautions</h2><ul>{listed}</ul>" if listed else ""


def _advice(analysis: Analysis, costs: Costs) -> str:
    rows = []
    for name, advice in (("weakly", analysis.weak_advice), ("strongly", analysis.strong_advice)):
        for number, (way, what, cost) in enumerate(advice_rows(advice)):
            first = f"{name} fault tolerant" if number == 0 else ""
            rows.append((first, way, escape(what), cost))
    used = {type_name(need[0]) for task in analysis.tasks for need in task.needs}
    prices = [f"{kind} {costs.robot(kind)}" for kind in sorted(analysis.mission.robot_types)]
    taught = [f"{name} {costs.capability(name)}" for name in sorted(used)][:MAX_MATRIX_COLUMNS]
    text = f"One more robot costs: {', '.join(prices)}. One more capability: {', '.join(taught)}."
    return (
        "<h2>Advice: what to add</h2>"
        + _table(("to make it", "", "add", "cost"), rows)
        + f"<p class='soft'>{escape(text)}</p>"
    )
