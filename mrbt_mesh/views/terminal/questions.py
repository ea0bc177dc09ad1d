"""What lies above the panes: the keys, and the question that stands before every order."""

from __future__ import annotations

from typing import ClassVar

from rich.text import Text
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import VerticalScroll
from textual.events import Key
from textual.screen import ModalScreen
from textual.widgets import Static

from mrbt_mesh.cli.views.marks import MARKS, STATE_MARKS
from mrbt_mesh.views.terminal.lanes import LEGEND

KEYS = (
    ("Tab, Shift+Tab", "next pane, the one before"),
    ("Up, Down, PgUp, End", "move; below stands why of what is selected"),
    ("m", "this pane alone, and all of them again"),
    ("Left, Right, Space", "tree: fold, unfold"),
    ("o", "tree: fold what does not run, or unfold all"),
    ("i", "tree: T_i of the selected robot, with T_A and T_Li; T_G again"),
    ("/ then n, N", "tree: search, the next one, the one before"),
    ("+, -", "timeline: larger, smaller"),
    ("Left, Right", "timeline: scroll in time"),
    ("l, w", "timeline: follow the run again; the whole run"),
    ("q", "quit; the team goes on"),
)


class Help(ModalScreen[None]):
    """Keys and signs; any key but those that scroll closes it."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("escape,question_mark,q,enter", "dismiss", "Close"),
    ]

    def __init__(self, orders: dict[str, str]) -> None:
        """`orders`: keys and what they order, if any may be given."""
        super().__init__()
        self._orders = orders

    def compose(self) -> ComposeResult:
        """The list."""
        with VerticalScroll(id="box") as box:
            box.border_title = "keys and signs (Esc closes)"
            yield Static(self._text())

    def _text(self) -> Text:
        text = Text()
        for key, meaning in (*KEYS, *self._orders.items()):
            text.append(f"{key:<22}", "bold")
            text.append(f"{meaning}\n")
        if not self._orders:
            text.append("To kill, freeze, pause and so on: mrbt watch --top --control\n", "dim")
        text.append("\nnodes   ", "bold")
        for status, (sign, style) in MARKS.items():
            text.append(f"{sign} {status.name.lower()}  ", style)
        text.append("\nrobots  ", "bold")
        for state, (sign, style) in STATE_MARKS.items():
            text.append(f"{sign} {state}  ", style)
        text.append("\nlanes   ", "bold")
        return text.append(LEGEND)


class OrderQuestion(ModalScreen[bool]):
    """Asks once: `y` is yes, every other key is no."""

    def __init__(self, title: str, text: str) -> None:
        super().__init__()
        self._title, self._text = title, text

    def compose(self) -> ComposeResult:
        """The question."""
        question = Static(
            Text.assemble(self._text, "\n\n", ("y", "bold"), " yes   any other key: no")
        )
        question.id = "box"
        question.border_title = self._title
        yield question

    def on_key(self, event: Key) -> None:
        """Answer."""
        event.stop()
        self.dismiss(event.key == "y")
