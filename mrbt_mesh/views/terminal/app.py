"""`mrbt watch --top`: a team in a terminal, by keys."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field
from typing import ClassVar

from textual.app import App, ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Horizontal
from textual.events import DescendantFocus, Resize
from textual.widgets import Footer, Input, Static

from mrbt_mesh.core.observer.observer import Observer
from mrbt_mesh.views.terminal.panes import (
    Lanes,
    RobotsPane,
    TimelinePane,
    TreePane,
    WhyPane,
    head_text,
)
from mrbt_mesh.views.terminal.questions import Help, OrderQuestion
from mrbt_mesh.views.terminal.rows import Rows
from mrbt_mesh.views.terminal.team import ShownTeam

# So often it is looked whether anything has changed.
LOOK_S = 0.1
ORDER_KEYS = {"k": "kill", "f": "freeze", "t": "thaw", "p": "pause", "r": "resume", "a": "abort"}


@dataclass(frozen=True)
class Orders:
    """What may be ordered. `robot` and `team`: name -> what it will do.

    `carry_out` is given {"act": name} and for a robot "robot" as well; it answers whether that was
    done, and says what.
    """

    carry_out: Callable[[dict[str, str]], Awaitable[tuple[bool, str]]]
    robot: dict[str, str] = field(default_factory=dict)
    team: dict[str, str] = field(default_factory=dict)

    def keys(self) -> dict[str, str]:
        """Key -> name, for those that may be given."""
        return {k: act for k, act in ORDER_KEYS.items() if act in self.robot or act in self.team}


class TeamTop(App[None]):
    """Shows what an observer knows; `clock_us` is the observer's clock."""

    CSS_PATH = "top.tcss"
    ENABLE_COMMAND_PALETTE = False
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("q", "quit", "quit"),
        Binding("question_mark", "help", "help", key_display="?"),
        Binding("slash", "search", "find", key_display="/"),
        Binding("n", "again(1)", "Next found", show=False),
        Binding("N", "again(-1)", "Found before", show=False),
        Binding("o", "fold_resting", "fold"),
        Binding("i", "own_tree", "T_i"),
        Binding("plus,equals_sign", "zoom(1)", "Larger", show=False),
        Binding("minus", "zoom(-1)", "Smaller", show=False),
        Binding("l", "follow", "Follow", show=False),
        Binding("w", "whole", "Whole run", show=False),
        Binding("m", "alone", "Maximise", show=False),
        *(Binding(key, f"order('{act}')", act) for key, act in ORDER_KEYS.items()),
    ]

    def __init__(
        self, observer: Observer, clock_us: Callable[[], int], orders: Orders | None = None
    ) -> None:
        super().__init__()
        self._clock_us = clock_us
        self._orders = orders
        self.shown = ShownTeam(observer)
        self.shown.update(clock_us())
        self._tree = TreePane(self.shown)
        self._robots = RobotsPane(self.shown)
        self._timeline = TimelinePane(self.shown)
        self._why = WhyPane(self.shown)
        self._words = ""
        self._drawn_s = -1.0

    def compose(self) -> ComposeResult:
        """The panes."""
        yield Static(id="head")
        with Horizontal(id="middle"):
            yield self._tree
            yield self._robots
        yield self._timeline
        yield self._why
        yield Input(
            placeholder="part of a node's label; Enter finds, Esc leaves", compact=True, id="search"
        )
        yield Footer(compact=True, show_command_palette=False)

    def on_mount(self) -> None:
        """Begin to look."""
        self.query_one("#search").display = False
        self._tree.focus()
        self.set_interval(LOOK_S, self.look)
        self.draw()

    def look(self) -> None:
        """Take over what the observer knows now, and draw it if it differs."""
        has_changed = self.shown.update(self._clock_us())
        if has_changed or self.shown.now_s != self._drawn_s:
            self.draw(only_time=not has_changed)

    def draw(self, only_time: bool = False) -> None:
        """Draw all panes, or those that change with time alone."""
        self._drawn_s = self.shown.now_s
        self.query_one("#head", Static).update(head_text(self.shown))
        self._timeline.look()
        if not only_time:
            self._tree.look()
            self._robots.look()
            self._share_height()
            self._why.look()

    def on_resize(self, event: Resize) -> None:
        """Give each pane its part of the window."""
        self._share_height(event.size.height)
        self.call_after_refresh(self._timeline.look)

    def _share_height(self, height: int = 0) -> None:
        """A lane per robot, in at most two fifths; to the explanation what the tree can spare."""
        height = height or self.size.height
        self._timeline.styles.height = min(len(self.shown.robots) + 2, max(height * 2 // 5, 4))
        self._why.styles.height = 5 if height < 30 else height // 4

    def on_rows_selected(self, event: Rows.Selected) -> None:
        """Explain what is selected; robots are selected in both of their panes."""
        if event.rows is self._tree:
            self._explain_task()
        else:
            self._robots.select(event.key)
            self._timeline.lanes.select(event.key)
            self._why.ask("robot", event.key)
            if self._tree.robot not in (None, event.key):
                self._show_own(event.key)

    def on_descendant_focus(self, event: DescendantFocus) -> None:
        """Explain what is selected in the pane that keys go to now."""
        if event.widget is self._tree:
            self._explain_task()
        elif isinstance(event.widget, RobotsPane | Lanes) and event.widget.selected is not None:
            self._why.ask("robot", event.widget.selected)

    def _explain_task(self) -> None:
        task = self._tree.global_task()
        if task is not None:
            self._why.ask("task", task)

    def action_own_tree(self) -> None:
        """T_i of the robot that is selected, in place of T_G; or T_G again."""
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
        """Keys and signs."""
        self.push_screen(Help({} if self._orders is None else self._orders.keys()))

    def action_search(self) -> None:
        """Ask for words."""
        search = self.query_one("#search", Input)
        search.display = True
        search.value = ""
        search.focus()

    def on_input_submitted(self, event: Input.Submitted) -> None:
        """Find the words."""
        self._words = event.value.strip()
        self.action_leave_search()
        self.action_again(1)

    def action_leave_search(self) -> None:
        """Back to the tree."""
        self.query_one("#search").display = False
        self._tree.focus()

    def on_key(self, event: object) -> None:
        """Esc leaves the search, or a robot's own tree."""
        if getattr(event, "key", "") != "escape":
            return
        if self.query_one("#search").display:
            self.action_leave_search()
        elif self._tree.robot is not None:
            self._tree.show_own(None)

    def action_again(self, step: int) -> None:
        """The next row with the words, or the one before."""
        if self._words and not self._tree.search(self._words, step):
            self.notify(f"no node has {self._words!r} in its label", severity="warning")

    def action_fold_resting(self) -> None:
        """Fold what does not run, or unfold all."""
        folds = self._tree.fold_resting()
        self.notify("what does not run is folded" if folds else "all is unfolded", timeout=2)

    def action_zoom(self, steps: int) -> None:
        """The timeline larger or smaller."""
        self._timeline.zoom(steps)

    def action_follow(self) -> None:
        """The end of the run, as it grows."""
        self._timeline.follow()

    def action_whole(self) -> None:
        """The whole run."""
        self._timeline.whole()

    def action_alone(self) -> None:
        """One pane alone, or all of them again."""
        focused = self.focused
        if self.screen.maximized is not None:
            self.screen.minimize()
        elif focused is not None:
            pane = self._timeline if focused is self._timeline.lanes else focused
            self.screen.maximize(pane, container=False)

    # -- orders -------------------------------------------------------------------------------

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Keys of orders are there only if such an order may be given."""
        if action != "order":
            return True
        return self._orders is not None and parameters[0] in self._orders.keys().values()

    def action_order(self, act: str) -> None:
        """Ask once, then have it carried out."""
        assert self._orders is not None
        order, meaning = {"act": act}, self._orders.team.get(act, "")
        if act in self._orders.robot:
            robot = self._robots.selected
            if robot is None:
                return
            order, meaning = {"act": act, "robot": robot}, self._orders.robot[act]
        title = " ".join(order.values())

        def answered(is_yes: bool | None) -> None:
            if is_yes:
                self.run_worker(self._carry_out(order))

        self.push_screen(OrderQuestion(f"{title}?", meaning), answered)

    async def _carry_out(self, order: dict[str, str]) -> None:
        assert self._orders is not None
        is_done, text = await self._orders.carry_out(order)
        self.notify(text, severity="information" if is_done else "error")
