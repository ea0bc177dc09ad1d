"""The screen: panes, keys, commands to the team, and the playback of a recording."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import ClassVar

from rich.text import Text
from textual.app import App, ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Horizontal, VerticalScroll
from textual.events import DescendantFocus, Key, Resize
from textual.screen import ModalScreen
from textual.widgets import Footer, Input, Static

from mrbt_mesh.cli.views.marks import MARKS, STATE_MARKS, STATE_WORDS
from mrbt_mesh.drills.control import CommandError, Control
from mrbt_mesh.recording.reader import RecordingError
from mrbt_mesh.views.model.team_view import Shown
from mrbt_mesh.views.replay.shown_recording import ShownRecording
from mrbt_mesh.views.terminal.lanes import LEGEND
from mrbt_mesh.views.terminal.panes import (
    JobsPane,
    Lanes,
    LogPane,
    RobotsPane,
    TimelinePane,
    TreePane,
    WhyPane,
    head_text,
)
from mrbt_mesh.views.terminal.rows import Rows
from mrbt_mesh.views.terminal.team import ShownTeam

# How often the screen is updated, and how often times in the list of jobs are.
LOOK_S, JOBS_LOOK_S = 0.1, 1.0
# Lower windows have two lines at the top; higher ones a line for each note.
TALL = 30
COMMAND_KEYS = {"k": "kill", "f": "freeze", "t": "thaw", "p": "pause", "r": "resume", "a": "abort"}
KEYS = {
    "Tab, Shift+Tab": "next pane, previous pane",
    "Up, Down, PgUp, End": "move; the pane below explains the selected row",
    "m": "this pane alone, or all of them again",
    "Left, Right, Space": "tree: fold, unfold",
    "o": "tree: fold what does not run, or unfold all",
    "i": "tree: T_i of the selected robot; T_G again",
    "/ then n, N": "tree: search, next match, previous match",
    "+, -": "timeline: zoom in, zoom out",
    "Left, Right ": "timeline: scroll in time",
    "l, w": "timeline: follow the run again; the whole run",
    "q": "quit; at `mrbt up` this ends the team",
}


class TeamTop(App[None]):
    """Shows a running team.

    `clock_us` is the observer's clock; `notes` returns the current lines at the top. With
    `control`, keys give the commands that it offers.
    """

    CSS_PATH = "top.tcss"
    ENABLE_COMMAND_PALETTE = False
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("q,ctrl+c", "quit", "quit", key_display="q"),
        Binding("question_mark", "help", "help", key_display="?"),
        Binding("slash", "search", "find", key_display="/"),
        Binding("n", "again(1)", "Next match", show=False),
        Binding("N", "again(-1)", "Previous match", show=False),
        Binding("o", "fold_resting", "Fold", show=False),
        Binding("i", "own_tree", "T_i"),
        Binding("plus,equals_sign", "zoom(1)", "Zoom in", show=False),
        Binding("minus", "zoom(-1)", "Zoom out", show=False),
        Binding("l", "follow", "Follow", show=False),
        Binding("w", "whole", "Whole run", show=False),
        Binding("m", "alone", "Maximise", show=False),
        *(Binding(key, f"command('{act}')", act) for key, act in COMMAND_KEYS.items()),
    ]
    MORE_KEYS: ClassVar[dict[str, str]] = {}

    def __init__(
        self,
        view: Shown,
        clock_us: Callable[[], int],
        control: Control | None = None,
        notes: Callable[[], Sequence[str]] = tuple,
    ) -> None:
        super().__init__()
        self._clock_us = clock_us
        self._control = control
        offers = {} if control is None else control.offers()
        # Commands for a robot, and for the team: command -> what it will do.
        self._robot_commands: dict[str, str] = offers.get("robot", {})
        self._team_commands: dict[str, str] = offers.get("team", {})
        self._notes = notes
        self.shown = ShownTeam(view)
        self.shown.update(clock_us())
        self._tree = TreePane(self.shown)
        self._robots = RobotsPane(self.shown)
        self._timeline = TimelinePane(self.shown)
        self._jobs = JobsPane(self.shown)
        self._why = WhyPane(self.shown)
        self._log_pane = LogPane(self.shown)
        self._words = ""
        self._drawn_s = self._jobs_drawn_s = -1.0

    def compose(self) -> ComposeResult:
        """The panes."""
        yield Static(id="head")
        with Horizontal(id="middle"):
            yield self._tree
            yield self._robots
        yield self._jobs
        yield self._timeline
        with Horizontal(id="bottom"):
            yield self._why
            yield self._log_pane
        yield Input(
            placeholder="part of a node's label; Enter finds, Esc leaves", compact=True, id="search"
        )
        yield Footer(compact=True, show_command_palette=False)

    def on_mount(self) -> None:
        """Start drawing."""
        self.query_one("#search").display = False
        self._tree.focus()
        self.set_interval(LOOK_S, self.look)
        self.draw()

    def look(self) -> None:
        """Update from the observer, and redraw if anything differs."""
        has_changed = self.shown.update(self._clock_us())
        if has_changed or self.shown.now_s != self._drawn_s:
            self.draw(only_time=not has_changed)

    def notes(self) -> Sequence[str]:
        """Return the current notes below the headline."""
        return self._notes()

    def head(self) -> Text:
        """Return the headline and the notes; a small window has two lines for them."""
        text, notes = head_text(self.shown), [*filter(None, self.notes())]
        if self.size.height < TALL:
            notes = ["  ".join(notes)] if notes else []
            text = self._within(text, 2 - len(notes))
        lines = [self._within(Text(f" {note}", "yellow"), 1) for note in notes]
        return Text("\n").join([text, *lines])

    def _within(self, text: Text, rows: int) -> Text:
        """Return the text cut to this many rows of the window; an ellipsis shows a cut."""
        width = max(self.size.width, 1)
        lines = list(text.wrap(self.console, width)) if rows > 1 else [text]
        if rows > 1 and len(lines) <= rows:
            return text
        above = lines[: rows - 1]
        last = text[sum(len(line) for line in above) :]
        last.truncate(width, overflow="ellipsis")
        return Text("\n").join([*above, last])

    def draw(self, only_time: bool = False) -> None:
        """Draw all panes, or only those that change with time."""
        self._drawn_s = self.shown.now_s
        self.query_one("#head", Static).update(self.head())
        self._timeline.look()
        if self._jobs.is_needed and not (only_time and self._are_jobs_fresh):
            self._jobs_drawn_s = self.shown.now_s
            self._jobs.look()
        if not only_time:
            self._tree.look()
            self._robots.look()
            self._share_height()
            self._why.look()
            self._log_pane.look()

    @property
    def _are_jobs_fresh(self) -> bool:
        return 0 <= self.shown.now_s - self._jobs_drawn_s < JOBS_LOOK_S

    def on_resize(self, event: Resize) -> None:
        """Distribute the window's height among the panes."""
        self._share_height(event.size.height)
        self.call_after_refresh(self._timeline.look)

    def _share_height(self, height: int = 0) -> None:
        """Set the panes' heights: a lane per robot in at most two fifths, and jobs at the lanes'
        expense.

        The explanation gets what the tree can spare.
        """
        height = height or self.size.height
        self._jobs.display = self._jobs.is_needed
        most = max(height // 4 if self._jobs.display else height * 2 // 5, 4)
        self._timeline.styles.height = min(len(self.shown.robots) + 2, most)
        self._jobs.styles.height = min(len(self.shown.jobs) + 2, max(height // 6, 4))
        self.query_one("#bottom").styles.height = 5 if height < TALL else height // 4
        self.query_one("#head").styles.max_height = 2 if height < TALL else None

    def on_rows_selected(self, event: Rows.Selected) -> None:
        """Explain the selection; robots are selected in both of their panes."""
        if event.rows is self._tree:
            self._explain_task()
        elif event.rows is self._jobs:
            self._why.ask("job", event.key)
        else:
            self._robots.select(event.key)
            self._timeline.lanes.select(event.key)
            self._why.ask("robot", event.key)
            if self._tree.robot not in (None, event.key):
                self._show_own(event.key)

    def on_descendant_focus(self, event: DescendantFocus) -> None:
        """Explain the selection of the pane that now has the focus."""
        if event.widget is self._tree:
            self._explain_task()
        elif event.widget is self._jobs and self._jobs.selected is not None:
            self._why.ask("job", self._jobs.selected)
        elif isinstance(event.widget, RobotsPane | Lanes) and event.widget.selected is not None:
            self._why.ask("robot", event.widget.selected)

    def _explain_task(self) -> None:
        task = self._tree.global_task()
        if task is not None:
            self._why.ask("task", task)

    def action_own_tree(self) -> None:
        """Show T_i of the selected robot instead of T_G, or T_G again."""
        robot = self._robots.selected
        if self._tree.robot is not None:
            self._tree.show_own(None)
        elif robot is not None:
            self._show_own(robot)

    def _show_own(self, robot: str) -> None:
        if self._tree.show_own(robot):
            self._why.ask("robot", robot)
        else:
            self.notify(f"{robot} has not joined yet", severity="warning", timeout=2)

    # -- keys ---------------------------------------------------------------------------------

    def action_help(self) -> None:
        """Show keys and signs."""
        self.push_screen(Help(KEYS | self.MORE_KEYS | self._commands(), self.notes()))

    def action_search(self) -> None:
        """Ask for the words to search."""
        search = self.query_one("#search", Input)
        search.display = True
        search.value = ""
        search.focus()

    def on_input_submitted(self, event: Input.Submitted) -> None:
        """Search for the words."""
        self._words = event.value.strip()
        self._leave_search()
        self.action_again(1)

    def _leave_search(self) -> None:
        self.query_one("#search").display = False
        self._tree.focus()

    def on_key(self, event: Key) -> None:
        """Leave the search, or a robot's own tree, on Esc."""
        if event.key == "escape" and self.query_one("#search").display:
            self._leave_search()
        elif event.key == "escape" and self._tree.robot is not None:
            self._tree.show_own(None)

    def action_again(self, step: int) -> None:
        """Select the next or previous row with the words."""
        if self._words and not self._tree.search(self._words, step):
            self.notify(f"no node has {self._words!r} in its label", severity="warning")

    def action_fold_resting(self) -> None:
        """Fold what is not running, or unfold everything."""
        folds = self._tree.fold_resting()
        self.notify("what does not run is folded" if folds else "all is unfolded", timeout=2)

    def action_zoom(self, steps: int) -> None:
        """Zoom the timeline."""
        self._timeline.zoom(steps)

    def action_follow(self) -> None:
        """Follow the end of the run as it grows."""
        self._timeline.follow()

    def action_whole(self) -> None:
        """Show the whole run."""
        self._timeline.whole()

    def action_alone(self) -> None:
        """Show one pane alone, or all of them again."""
        focused = self.focused
        if self.screen.maximized is not None:
            self.screen.minimize()
        elif focused is not None:
            pane = self._timeline if focused is self._timeline.lanes else focused
            self.screen.maximize(pane, container=False)

    # -- commands -------------------------------------------------------------------------------

    def _commands(self) -> dict[str, str]:
        """Return key -> command for the available commands."""
        offered = {**self._robot_commands, **self._team_commands}
        return {key: act for key, act in COMMAND_KEYS.items() if act in offered}

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Enable keys of commands only if the command is available."""
        return action != "command" or parameters[0] in self._commands().values()

    def action_command(self, act: str) -> None:
        """Ask for confirmation, then carry out the command."""
        command, meaning = {"act": act}, self._team_commands.get(act, "")
        if act in self._robot_commands:
            robot = self._robots.selected
            if robot is None:
                return
            command, meaning = {"act": act, "robot": robot}, self._robot_commands[act]

        def answered(is_yes: bool | None) -> None:
            if is_yes:
                self.run_worker(self._carry_out(command))

        self.push_screen(CommandQuestion(f"{' '.join(command.values())}?", meaning), answered)

    async def _carry_out(self, command: dict[str, str]) -> None:
        assert self._control is not None
        try:
            self.notify(await self._control.carry_out(command))
        except CommandError as error:
            self.notify(str(error), severity="error")


# -- a recording ------------------------------------------------------------------------------

STEP_S, FASTER = 5.0, 2.0
# How many records are played before the clock is read again.
STEP_RECORDS = 20


class ReplayTop(TeamTop):
    """Plays a recording. `problem`: the error that ended it."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("space", "pause", "pause", priority=True),
        Binding("comma", f"go({-STEP_S})", f"-{STEP_S:g} s", key_display=","),
        Binding("full_stop", f"go({STEP_S})", f"+{STEP_S:g} s", key_display="."),
        Binding("less_than_sign", f"speed({1 / FASTER})", "slower", key_display="<"),
        Binding("greater_than_sign", f"speed({FASTER})", "faster", key_display=">"),
    ]
    MORE_KEYS: ClassVar[dict[str, str]] = {
        "Space": "pause, play on",
        ", .": f"{STEP_S:g} s back, {STEP_S:g} s on",
        "< >": "slower, faster",
    }

    def __init__(self, recording: ShownRecording) -> None:
        self._recording = recording
        self._looked_s = time.monotonic()
        self.problem: RecordingError | None = None
        super().__init__(recording, lambda: recording.playback.at_us)

    def notes(self) -> Sequence[str]:
        """Return the position in the recording."""
        playback, about = self._recording.playback, self._recording.to_json()
        how = "paused" if playback.is_paused else f"{playback.speed:g} times as fast"
        done_s = self._recording.seconds(playback.at_us) - about["from_s"]
        length_s = about["to_s"] - about["from_s"]
        text = f"{about['file']}: {done_s:.1f} of {length_s:.1f} s, {how}"
        read_s = self._recording.read_s
        if read_s is not None:
            text += f", timeline read up to {read_s - about['from_s']:.0f} s"
        return [text]

    def look(self) -> None:
        """Play on for the time that has passed."""
        now_s = time.monotonic()
        self._recording.passed(now_s - self._looked_s)
        self._looked_s = now_s
        # Large plans take long to compute: keys are processed in between.
        try:
            while not self._recording.step(STEP_RECORDS) and time.monotonic() < now_s + LOOK_S:
                pass
            while not self._recording.read(STEP_RECORDS) and time.monotonic() < now_s + LOOK_S / 2:
                pass
        except RecordingError as error:
            self.problem = error
            self.exit()
        super().look()

    def action_pause(self) -> None:
        """Pause or play; at the end, play from the beginning."""
        self._recording.play(not self._recording.playback.is_paused)

    def action_go(self, seconds: float) -> None:
        """Go back or forward."""
        playback = self._recording.playback
        playback.go_to(playback.at_us + round(seconds * 1e6))

    def action_speed(self, factor: float) -> None:
        """Play faster or slower."""
        self._recording.playback.set_speed(self._recording.playback.speed * factor)


# -- above the panes --------------------------------------------------------------------------


class Help(ModalScreen[None]):
    """Keys and signs."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("escape,question_mark,q,enter", "dismiss", "Close"),
    ]

    def __init__(self, keys: dict[str, str], notes: Sequence[str]) -> None:
        super().__init__()
        self._keys, self._notes = keys, notes

    def compose(self) -> ComposeResult:
        """The list."""
        text = Text("".join(f"{note}\n" for note in self._notes), "yellow")
        for key, meaning in self._keys.items():
            text.append(f"{key:<22}", "bold")
            text.append(f"{meaning}\n")
        if not COMMAND_KEYS.keys() & self._keys:
            text.append("To kill, freeze, pause and so on: mrbt watch --top --control\n", "dim")
        text.append("\nnodes   ", "bold")
        for status, (sign, style) in MARKS.items():
            text.append(f"{sign} {status.name.lower()}  ", style)
        text.append("\nrobots  ", "bold")
        for state, (sign, style) in STATE_MARKS.items():
            text.append(f"{sign} {STATE_WORDS.get(state, state)}  ", style)
        text.append("\nlanes   ", "bold")
        with VerticalScroll(id="box") as box:
            box.border_title = "keys and signs (Esc closes)"
            yield Static(text.append(LEGEND))


class CommandQuestion(ModalScreen[bool]):
    """Asks for confirmation: `y` is yes, every other key is no."""

    def __init__(self, title: str, text: str) -> None:
        super().__init__()
        self._title, self._text = title, text

    def compose(self) -> ComposeResult:
        """The question."""
        text = Text.assemble(self._text, "\n\n", ("y", "bold"), " yes   any other key: no")
        question = Static(text, id="box")
        question.border_title = self._title
        yield question

    def on_key(self, event: Key) -> None:
        """Answer."""
        event.stop()
        self.dismiss(event.key == "y")
