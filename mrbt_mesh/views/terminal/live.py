"""The live terminal view of a running team, drawn from an Observer alone."""

from __future__ import annotations

from dataclasses import dataclass

from rich.console import RenderableType
from rich.layout import Layout
from rich.panel import Panel
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text
from rich.tree import Tree as RichTree

from mrbt_mesh.cli.views.marks import MARKS, STATE_MARKS
from mrbt_mesh.cli.views.summary_view import capability_changes
from mrbt_mesh.cli.views.tree_view import render_tree
from mrbt_mesh.core.bt.tree import Status
from mrbt_mesh.core.facts.records import Phase
from mrbt_mesh.core.membership.peer import State
from mrbt_mesh.core.mission.mission import MissionEnd
from mrbt_mesh.core.observer.observer import Observer
from mrbt_mesh.core.observer.run_record import RunRecord
from mrbt_mesh.views.terminal.lanes import Past, RecordedPast, Window, axis, lane, latest_fault

# Columns of robots and timeline, at least; from how many on the robots' trees have room.
LEAST_RIGHT = 44
WIDE = 66
LEAST_LOG = 3
# Lines of frames and heads of robots, timeline and log.
FRAMES = 8


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


class LiveView:
    """Draws an observer, again and again; another one, as after a leap in a replay, begins anew."""

    def __init__(self) -> None:
        self._past = RecordedPast()

    def render(
        self,
        observer: Observer,
        now_us: int,
        size: tuple[int, int],
        notes: LiveNotes | None = None,
    ) -> RenderableType:
        """One frame for a window of (columns, lines): all of it is used."""
        width, height = size
        tree = _tree(observer)
        top = [_header(observer, now_us), *(notes or LiveNotes()).lines()]
        right_width = max(width * 3 // 5, min(width, LEAST_RIGHT))
        spare = height - len(top) - LEAST_LOG - FRAMES
        right = self._right(observer, now_us, right_width, spare)
        needed = max(sum(lines for _, lines in right), _lines(tree) + 2)
        log_lines = max(LEAST_LOG, height - len(top) - needed - 2)
        layout = Layout()
        layout.split_column(
            Layout(Text("\n").join(top), size=len(top)),
            Layout(name="middle"),
            Layout(_log(observer, log_lines), size=log_lines + 2),
        )
        layout["middle"].split_row(
            Layout(_panel(tree, "T_G")), Layout(name="right", size=right_width)
        )
        # The last one takes what is left.
        parts = [Layout(panel, size=lines) for panel, lines in right[:-1]]
        layout["right"].split_column(*parts, Layout(right[-1][0]))
        return layout

    def _right(
        self, observer: Observer, now_us: int, width: int, spare: int
    ) -> list[tuple[Panel, int]]:
        """Robots, what is blocked, timeline, with their lines; `spare`: those for rows."""
        record, robots = observer.record, observer.robots()
        blocked = [f"{e.request} {e.reason}" for e in record.blocked if e.to_us is None]
        # Every robot has a row and a lane.
        most = max(1, (spare - (len(blocked) + 2 if blocked else 0)) // 2)
        shown = robots if len(robots) <= most else robots[: most - 1]
        more = len(robots) - len(shown)
        past = self._past.of(record)
        now_s = record.seconds(record.ended_us or now_us) or 0.0
        table = _robots(observer, shown, more, width)
        found = [(_panel(table, "robots"), len(shown) + (more > 0) + 3)]
        if blocked:
            text = Text("\n").join(Text(line, "red") for line in blocked)
            found.append((_panel(text, "blocked", "red"), len(blocked) + 2))
        lanes = _lanes(past, shown, now_s, width - 4)
        found.append((_panel(lanes, f"timeline  {latest_fault(past)}".rstrip()), len(shown) + 3))
        return found


def _panel(inside: RenderableType, title: str, style: str = "dim") -> Panel:
    return Panel(inside, title=Text(title), title_align="left", border_style=style)


def _lines(tree: RenderableType) -> int:
    """How many lines a tree takes, none of which is wrapped."""
    if not isinstance(tree, RichTree):
        return 1
    if isinstance(tree.label, Text):
        tree.label.no_wrap, tree.label.overflow = True, "ellipsis"
    return 1 + sum(map(_lines, tree.children))


def _lanes(past: Past, robots: list[str], now_s: float, width: int) -> Text:
    """The end of the run: a lane per robot, the seconds below."""
    name_width = max(map(len, robots), default=0) + 1
    window = Window.latest(now_s, max(1, width - name_width))
    lines = [
        Text.assemble((f"{robot:{name_width}}", "bold"), lane(past, robot, window, now_s))
        for robot in robots
    ]
    return Text("\n", no_wrap=True).join([*lines, Text(" " * name_width) + axis(window)])


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


def _robots(observer: Observer, robots: list[str], more: int, width: int) -> Table:
    table = Table(box=None, header_style="dim", pad_edge=False, expand=True)
    table.add_column("robot", no_wrap=True)
    table.add_column("state", no_wrap=True)
    is_wide = width >= WIDE
    if is_wide:
        table.add_column("T_i T_A T_G T_Li", no_wrap=True, min_width=16)
    table.add_column("works on", ratio=1, no_wrap=True)
    table.add_column("", no_wrap=True)
    for robot in robots:
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
        if member is not None:
            found = member.member
            row = {"lost": found.lost, "pending": found.pending}
            for line in capability_changes(row).split():
                work.append(" ").append_text(line)
        for problem in observer.facts.problems.get(robot, {}).values():
            work.append(f" {problem}", style="red")
        bar: RenderableType = progress
        if claim is not None and beat is not None and claim.phase is Phase.RUNNING:
            bar = ProgressBar(total=100, completed=beat.progress, width=8)
        statuses = _statuses(beat.statuses if beat and present else ())
        table.add_row(
            Text.assemble((robot, "bold"), (kind, "dim")),
            Text(str(state), style=STATE_MARKS[str(state)][1]),
            *([statuses] if is_wide else []),
            work,
            bar,
        )
    if more:
        table.add_row(Text(f"… {more} more", "dim"))
    return table


def _statuses(statuses: tuple[int, ...]) -> Text:
    text = Text()
    for status in statuses:
        sign, style = MARKS[Status(status)]
        text.append(f" {sign}  ", style=style)
    return text


def _log(observer: Observer, lines: int) -> Panel:
    record = observer.record
    text = Text(no_wrap=True, overflow="ellipsis")
    for at_us, line in record.timeline[-lines:]:
        style = "red" if "dead" in line or "blocked:" in line or "lost" in line else ""
        style = "red" if " failed" in line else style
        text.append(f"{record.seconds(at_us) or 0:7.2f} ", style="dim")
        text.append(line + "\n", style=style)
    text.rstrip()
    return _panel(text, "what happened")
