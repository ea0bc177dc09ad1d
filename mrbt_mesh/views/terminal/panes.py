"""The panes of the screen; `look` draws the current state of the team."""

from __future__ import annotations

import math
import re
from typing import Any, ClassVar

from rich.markup import escape
from rich.text import Text
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Vertical, VerticalScroll
from textual.widgets import Static

from mrbt_mesh.cli.views.marks import by_urgency, statement_text
from mrbt_mesh.core.bt.tree import Kind
from mrbt_mesh.views.model.why import why_robot, why_task
from mrbt_mesh.views.terminal.job_rows import (
    MOST,
    counts_text,
    in_order,
    job_details,
    job_text,
    nothing_text,
)
from mrbt_mesh.views.terminal.lanes import LEAST_S, USUAL_S, Window, axis, lane, latest_fault
from mrbt_mesh.views.terminal.robot_rows import (
    capabilities_text,
    robot_text,
    trees_text,
    why_text,
)
from mrbt_mesh.views.terminal.rows import Rows
from mrbt_mesh.views.terminal.team import ShownTeam
from mrbt_mesh.views.terminal.tree_rows import FoldingTree, RobotRows

ZOOM = 1.5
# A sideways step scrolls by this fraction of the shown span.
SIDE = 4
# The shortest span: below it, a column is shorter than the time that a message takes.
SHORTEST_S = 0.5
# Events that are shown in red.
ALARMING = re.compile(r"dead|blocked:|lost| failed")


def head_text(shown: ShownTeam) -> Text:
    """Return the headline: mission, time, and statements about the team, the worst first."""
    team = shown.team
    text = Text(overflow="ellipsis")
    text.append(f" {shown.mission['name']} ", "bold reverse")
    text.append(f" {shown.now_s:.1f} s  " if team["started"] else " not begun  ")
    for statement in shown.headline:
        for part, style in statement_text(statement).spans:
            text.append(part, style)
        text.append("  ")
    if team["rounds"] > 1:
        text.append(f"round {team['rounds']}  ")
    text.right_crop(2)
    return text


class TreePane(Rows):
    """Shows T_G, or T_i of a robot."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("left", "fold(True)", "Fold", show=False),
        Binding("right", "fold(False)", "Unfold", show=False),
        Binding("space,enter", "turn", "Fold or unfold", show=False),
    ]

    def __init__(self, shown: ShownTeam) -> None:
        super().__init__(id="tree")
        self.border_title = "tree"
        self._shown = shown
        self._mission = shown.mission
        self._team_rows = self.tree_rows = FoldingTree(shown.mission["tree"])
        self._own: RobotRows | None = None
        # The row of T_G that was selected before T_i was shown.
        self._team_row = 0

    @property
    def robot(self) -> str | None:
        """The robot whose T_i is shown; None if T_G is shown."""
        return None if self._own is None else self._own.robot

    def show_own(self, robot: str | None) -> bool:
        """Show a robot's T_i, or T_G for None. Returns False if the robot has not joined yet."""
        if robot is None:
            self._own, self.tree_rows, self.border_title = None, self._team_rows, "tree"
            self.look()
            self.select(self._team_row)
            return True
        try:
            found = RobotRows(self._shown.observer, robot)
        except KeyError:
            return False
        if self._own is None:
            self._team_row = self.selected or 0
        self._own, self.tree_rows = found, FoldingTree(found.rows)
        self.border_title = escape(f"T_i of {robot}  Esc: T_G")
        self.look()
        self.select(0)
        return True

    def look(self) -> None:
        """Draw the current state."""
        if self._shown.mission is not self._mission:  # another revision is in force
            self._mission = self._shown.mission
            self._team_rows, self._team_row = FoldingTree(self._mission["tree"]), 0
            self.show_own(None)
            return
        if self._own is not None and not self._own.is_of(self._shown.observer):
            if not self.show_own(self._own.robot):
                self.show_own(None)
            return
        nodes = self._statuses()
        rows = self.tree_rows.visible(nodes)
        texts = [self.tree_rows.text(index, depth, nodes) for index, depth in rows]
        self.show([index for index, _ in rows], texts)

    def _statuses(self) -> dict[int, list[Any]]:
        if self._own is None:
            return self._shown.nodes
        return self._own.nodes(self._shown.robots[self._own.robot]["statuses"])

    def action_fold(self, is_folded: bool) -> None:
        """Fold or unfold the selected row; if it is folded already, select its parent."""
        index = self.selected
        if index is None:
            return
        rows, nodes = self.tree_rows, self._statuses()
        if is_folded and (rows.is_folded(index, nodes) or not rows.children(index)):
            self.select(rows.parent(index))
        else:
            rows.fold(index, is_folded)
            self.look()

    def action_turn(self) -> None:
        """Toggle the fold of the selected row."""
        if self.selected is not None:
            is_folded = self.tree_rows.is_folded(self.selected, self._statuses())
            self.tree_rows.fold(self.selected, not is_folded)
            self.look()

    def fold_resting(self) -> bool:
        """Fold what is not running, or unfold everything; return whether it is folded now."""
        self.tree_rows.fold_resting(not self.tree_rows.folds_resting)
        self.look()
        return self.tree_rows.folds_resting

    def search(self, words: str, step: int = 1) -> bool:
        """Select the next row with these words; return whether there is one."""
        index = self.tree_rows.find(words, -1 if self.selected is None else self.selected, step)
        if index is None:
            return False
        self.tree_rows.reveal(index)
        self.look()
        self.select(index)
        return True

    def global_task(self) -> str | None:
        """Return the global task of the selected row; None in a robot's own tree."""
        if self._own is not None or not self.keys:
            return None
        row = self._shown.mission["tree"][self.selected]
        return row["subject"] if row["kind"] == str(Kind.ACTION) else None


class RobotsPane(Rows):
    """Shows a row per robot."""

    def __init__(self, shown: ShownTeam) -> None:
        super().__init__(id="robots")
        self.border_title = "robots"
        self._shown = shown

    def look(self) -> None:
        """Draw the current state."""
        robots = self._shown.robots
        width = max(map(len, robots), default=0)
        names = by_urgency(robots)
        is_over = self._shown.team["ended"] is not None
        now_s = self._shown.now_s
        self.show(names, [robot_text(name, robots[name], width, now_s, is_over) for name in names])


class JobsPane(Rows):
    """Shows a row per job, in missions with jobs."""

    def __init__(self, shown: ShownTeam) -> None:
        super().__init__(id="jobs")
        self._shown = shown

    @property
    def is_needed(self) -> bool:
        """True if the mission has jobs, or had them before it was revised."""
        return bool(self._shown.observer.mission.jobs or self._shown.jobs)

    def look(self) -> None:
        """Draw the current state."""
        jobs, types = self._shown.jobs, self._shown.observer.mission.jobs
        names = in_order(jobs)[:MOST]
        texts = [job_text(name, jobs[name], self._shown.unix_us) for name in names]
        if not jobs and types:
            texts = [Text(nothing_text(types), "dim", no_wrap=True)]
        self.show(names, texts)
        self.border_title = escape(f"jobs  {counts_text(jobs.values())}")
        hidden = len(jobs) - len(names)
        self.border_subtitle = f"{hidden} more: mrbt jobs" if hidden else ""


class Lanes(Rows):
    """The lanes of the timeline."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("left", "side(-1)", "Back", show=False),
        Binding("right", "side(1)", "On", show=False),
    ]

    def action_side(self, steps: int) -> None:
        """Scroll in time, which stops following the run."""
        assert isinstance(self.parent, TimelinePane)
        self.parent.go_to_the_side(steps)


class TimelinePane(Vertical):
    """Shows a lane per robot, with the seconds below."""

    def __init__(self, shown: ShownTeam) -> None:
        super().__init__(id="timeline")
        self._shown = shown
        self.lanes = Lanes(id="lanes")
        self._axis = Static(id="axis")
        # The shown span in seconds; None: the usual one; infinite: the whole run.
        self.span_s: float | None = None
        # The end of the span; None: now.
        self.to_s: float | None = None

    def compose(self) -> ComposeResult:
        """Lanes and axis."""
        yield self.lanes
        yield self._axis

    @property
    def _end_s(self) -> float:
        """Now, or the expected end; at least half of the usual span remains for the past."""
        return min(self._shown.expected_end_s, self._shown.now_s + USUAL_S / 2)

    def window(self, width: int) -> Window:
        """Return the shown time span, in `width` columns."""
        now_s = self._end_s
        usual = Window.latest(now_s, width)
        if self.span_s is None and self.to_s is None:
            return usual
        span_s = self.span_s or usual.to_s - usual.from_s
        if span_s == math.inf:
            span_s = max(now_s, LEAST_S)
        to_s = max(span_s, now_s if self.to_s is None else self.to_s)
        return Window(to_s - span_s, to_s, width)

    def look(self) -> None:
        """Draw the current state."""
        robots = by_urgency(self._shown.robots)
        name_width = max(map(len, robots), default=0) + 1
        # One column before for the selection mark, and a free column after.
        window = self.window(max(self.lanes.size.width - name_width - 2, 1))
        texts = []
        for robot in robots:
            text = Text(no_wrap=True).append(f"{robot:{name_width}}", "bold")
            text.append_text(lane(self._shown, robot, window))
            texts.append(text)
        self.lanes.show(robots, texts)
        line = Text(" " * (name_width + 1), no_wrap=True)
        self._axis.update(line.append_text(axis(window)))
        how = "follows" if self.to_s is None else "l: follow again"
        title = f"timeline  {window.to_s - window.from_s:.3g} s, {how}"
        if (forecast := self._shown.forecast) is not None:
            ends = f", ends at {self._shown.expected_end_s:.1f} s" if forecast["ends_s"] else ""
            title += f"  {forecast['reason']}{ends}"
        self.border_title = escape(f"{title}  {latest_fault(self._shown)}")

    def zoom(self, steps: int) -> None:
        """Zoom in by some steps; negative steps zoom out."""
        window = self.window(1)
        span_s = (window.to_s - window.from_s) / ZOOM**steps
        self.span_s = min(max(span_s, SHORTEST_S), max(self._shown.now_s, LEAST_S))
        self.look()

    def go_to_the_side(self, steps: int) -> None:
        """Scroll in time; at the end of the run, follow it again."""
        window = self.window(1)
        to_s = window.to_s + steps * (window.to_s - window.from_s) / SIDE
        self.span_s = window.to_s - window.from_s
        self.to_s = max(to_s, self.span_s) if to_s < self._end_s else None
        self.look()

    def follow(self) -> None:
        """Show the end of the run, as it grows."""
        self.span_s = self.to_s = None
        self.look()

    def whole(self) -> None:
        """Show the run from its start until now."""
        self.span_s, self.to_s = math.inf, None
        self.look()


class WhyPane(VerticalScroll):
    """Explains the state of a robot, a global task or a job; for a robot, also what it can do."""

    def __init__(self, shown: ShownTeam) -> None:
        super().__init__(id="why")
        self._shown = shown
        self._text = Static(id="why-text")
        self.subject: tuple[str, str] | None = None
        self._is_chosen = False

    def compose(self) -> ComposeResult:
        """The text."""
        yield self._text

    def ask(self, kind: str, name: str) -> None:
        """Explain a `robot`, a `task` or a `job`, and keep the explanation up to date."""
        self._is_chosen = True
        if self.subject != (kind, name):
            self.scroll_home(animate=False)
        self.subject = kind, name
        self.look()

    def _worst(self) -> tuple[str, str] | None:
        """Return what is blocked, else the newest death."""
        plan, faults = self._shown.observer.plan, self._shown.faults
        blocked = [w.global_task for w in plan.waiting if w.is_blocked] if plan else []
        if blocked:
            return "task", blocked[0]
        return ("robot", faults[-1]["robot"]) if faults else None

    def look(self) -> None:
        """Draw the explanation; until something is selected, that of the worst problem."""
        if not self._is_chosen:
            self.subject = self._worst()
        if self.subject is None:
            self.border_title = "why"
            self._text.update(Text("Select a task, or with Tab a robot or a job.", "dim"))
            return
        kind, name = self.subject
        self.border_title = escape(f"why {name}")
        if kind == "job":
            item = self._shown.jobs.get(name)
            gone = Text(f"{name} is not kept any more.", "dim")
            known = gone if item is None else job_details(name, item, self._shown.unix_us)
            self._text.update(known)
        elif kind == "task":
            self._text.update(why_text(why_task(self._shown.observer, name)))
        elif name in self._shown.robots:
            self._text.update(self._robot(name))
        else:
            self._text.update(Text(f"{name} has not been heard yet.", "dim"))

    def _robot(self, name: str) -> Text:
        item: dict[str, Any] = self._shown.robots[name]
        answer, takeover = why_robot(self._shown.observer, name), self._shown.takeover_of(name)
        if takeover is not None and takeover["sentence"].startswith(answer["sentence"]):
            # The robot is dead: the explanation of the takeover includes its death.
            answer, takeover = takeover, None
        text = why_text(answer)
        if takeover is not None:
            text.append(f"\n{takeover['subject']}: ", "bold")
            text.append_text(why_text(takeover))
        for part in (
            capabilities_text(item),
            Text("\n".join(item["problems"]), "red"),
            trees_text(item),
        ):
            if part:
                text.append("\n").append_text(part)
        return text


class LogPane(Static):
    """Shows the latest events."""

    def __init__(self, shown: ShownTeam) -> None:
        super().__init__(id="log")
        self.border_title = "what happened"
        self._shown = shown

    def look(self) -> None:
        """Draw the current state."""
        text = Text(no_wrap=True, overflow="ellipsis")
        for event in self._shown.events[-max(self.size.height, 1) :]:
            text.append(f"{event['at_s'] or 0.0:7.2f} ", "dim")
            text.append(f"{event['text']}\n", "red" if ALARMING.search(event["text"]) else "")
        text.rstrip()
        older = self._shown.older_events
        self.border_subtitle = f"{older} older entries: see the recording" if older else ""
        self.update(text)
