"""The live terminal view of a running team, drawn from an Observer alone."""

from __future__ import annotations

from dataclasses import dataclass

from rich.console import Group, RenderableType
from rich.layout import Layout
from rich.panel import Panel
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from mrbt_mesh.cli.views.tree_view import MARKS, render_tree
from mrbt_mesh.core.bt.tree import Status
from mrbt_mesh.core.facts.records import Phase
from mrbt_mesh.core.membership.peer import State
from mrbt_mesh.core.mission.mission import MissionEnd
from mrbt_mesh.core.observer.observer import Observer
from mrbt_mesh.core.observer.run_record import RunRecord

STATE_STYLES = {
    State.ALIVE: "green",
    State.SUSPECT: "yellow",
    State.DEAD: "bold red",
    State.LEFT: "dim",
}


@dataclass(frozen=True)
class LiveNotes:
    """What stands below the header as long as it runs: a warning, the address of the live page."""

    warning: str = ""
    page: str = ""

    def lines(self) -> list[Text]:
        """One line each."""
        page = Text.assemble((" page: ", "dim"), (self.page, "cyan")) if self.page else None
        warning = Text(f" {self.warning}", "yellow") if self.warning else None
        return [line for line in (page, warning) if line is not None]


def render_live(
    observer: Observer, now_us: int, height: int, notes: LiveNotes | None = None
) -> RenderableType:
    """One frame; `height` in lines."""
    robots = _robots(observer)
    record = observer.record
    rows = len(observer.robots()) + 4
    log_lines = max(3, min(10, height - rows - 12))
    layout = Layout()
    top = [_header(observer, now_us), *(notes or LiveNotes()).lines()]
    layout.split_column(
        Layout(Text("\n").join(top), size=len(top)),
        Layout(name="middle"),
        Layout(_log(observer, log_lines), size=log_lines + 2),
    )
    right = [Panel(robots, title="robots", title_align="left", border_style="dim")]
    blocked = [episode for episode in record.blocked if episode.to_us is None]
    if blocked:
        text = Text("\n").join(Text(f"{e.request} {e.reason}", style="red") for e in blocked)
        right.append(Panel(text, title="blocked", title_align="left", border_style="red"))
    layout["middle"].split_row(
        Layout(Panel(_tree(observer), title="T_G", title_align="left", border_style="dim")),
        Layout(Group(*right), size=68),
    )
    return layout


def _header(observer: Observer, now_us: int) -> Text:
    plan, record = observer.plan, observer.record
    status = plan.result if plan else Status.IDLE
    sign, style = MARKS[status]
    elapsed_s = record.seconds(record.ended_us or now_us) if record.started_us else 0.0
    agreed = observer.agreement
    return Text.assemble(
        (f" {observer.mission.name} ", "bold reverse"),
        f"  {elapsed_s:6.1f} s  ",
        (f"{sign} {status.name.lower()}", style),
        _round(record),
        "   ",
        ("● all agree" if agreed else "○ agreeing…", "green" if agreed else "yellow"),
        f"   {len(observer.facts.map)} facts",
    )


def _round(record: RunRecord) -> str:
    """Which round it is, where the mission never ends."""
    if record.mission.ends is MissionEnd.ONCE or record.started_us is None:
        return ""
    number = len(record.rounds.all)
    return f"  round {number}" if record.rounds.current else f"  stands by, rounds: {number}"


def _tree(observer: Observer) -> RenderableType:
    plan = observer.plan
    if plan is None:
        return Text("waiting for the team…", style="dim")
    working: dict[str, list[str]] = {}
    for robot in observer.robots():
        claim = observer.claim(robot)
        if claim is not None:
            working.setdefault(claim.activation, []).append(robot)
    waiting = {w.activation: w for w in plan.waiting}
    notes = {}
    for request in plan.evaluation.requests:
        if request.activation in working:
            notes[request.node] = Text(" ".join(working[request.activation]), style="bold cyan")
        elif request.activation in waiting:
            found = waiting[request.activation]
            waits = "waits for bids" if found.awaited else "waits"
            notes[request.node] = Text(
                "blocked" if found.is_blocked else waits, "red" if found.is_blocked else "dim"
            )
    return render_tree(observer.mission.tree, plan.evaluation, notes)


def _robots(observer: Observer) -> Table:
    table = Table(box=None, header_style="dim", pad_edge=False, expand=True)
    table.add_column("robot", no_wrap=True)
    table.add_column("state", no_wrap=True)
    table.add_column("T_i T_A T_G T_Li", no_wrap=True, min_width=16)
    table.add_column("works on", ratio=1)
    table.add_column("", no_wrap=True)
    for robot in observer.robots():
        state = observer.robot_state(robot)
        peer = observer.membership.peers.get(robot)
        beat = peer.heartbeat if peer else None
        member = observer.facts.members.get(robot)
        kind = f" {member[0].type}" if member else ""
        claim = observer.claim(robot)
        work, progress = Text(""), Text("")
        if claim is not None:
            running = claim.phase is Phase.RUNNING
            work = Text(claim.local_task, style="" if running else "dim")
        present = state in (State.ALIVE, State.SUSPECT)
        if member and member[0].lost:
            work.append(f" lost {', '.join(member[0].lost)}", style="red")
        bar: RenderableType = progress
        if claim is not None and beat is not None and claim.phase is Phase.RUNNING:
            bar = ProgressBar(total=100, completed=beat.progress, width=8)
        table.add_row(
            Text.assemble((robot, "bold"), (kind, "dim")),
            Text(str(state), style=STATE_STYLES[state]),
            _statuses(beat.statuses if beat and present else ()),
            work,
            bar,
        )
    return table


def _statuses(statuses: tuple[int, ...]) -> Text:
    text = Text()
    for status in statuses:
        sign, style = MARKS[Status(status)]
        text.append(f" {sign}  ", style=style)
    return text


def _log(observer: Observer, lines: int) -> Panel:
    record = observer.record
    text = Text()
    for at_us, line in record.timeline[-lines:]:
        style = "red" if "dead" in line or "blocked:" in line or "lost" in line else ""
        text.append(f"{record.seconds(at_us) or 0:7.2f} ", style="dim")
        text.append(line + "\n", style=style)
    text.rstrip()
    return Panel(text, title="what happened", title_align="left", border_style="dim")
