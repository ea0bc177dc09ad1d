"""A scrolling list of rows, one of them selected; only rows on screen are drawn."""

from __future__ import annotations

from typing import Any, ClassVar

from rich.style import Style
from rich.text import Text
from textual.binding import Binding, BindingType
from textual.events import Click
from textual.geometry import Size
from textual.message import Message
from textual.scroll_view import ScrollView
from textual.strip import Strip


class Rows(ScrollView, can_focus=True):
    """Rows with keys; the selected key stays selected while rows come and go."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("up", "move(-1)", "Up", show=False),
        Binding("down", "move(1)", "Down", show=False),
        Binding("pageup", "page(-1)", "Page up", show=False),
        Binding("pagedown", "page(1)", "Page down", show=False),
        Binding("home", "move(-1000000)", "First", show=False),
        Binding("end", "move(1000000)", "Last", show=False),
    ]

    class Selected(Message):
        """Another row was selected."""

        def __init__(self, rows: Rows, key: Any) -> None:
            super().__init__()
            self.rows = rows
            self.key = key

    def __init__(self, **names: Any) -> None:
        super().__init__(**names)
        self.keys: list[Any] = []
        self._texts: list[Text] = []
        self._at = 0

    @property
    def selected(self) -> Any:
        """The key of the selected row; None without rows."""
        return self.keys[self._at] if self.keys else None

    def show(self, keys: list[Any], texts: list[Text]) -> None:
        """Draw these rows; the selected key stays selected if it still exists."""
        before = self.selected
        self.keys, self._texts = keys, texts
        if before in keys:
            self._at = keys.index(before)
        self._at = min(self._at, max(len(keys) - 1, 0))
        size = Size(self.size.width, len(keys))
        if size != self.virtual_size:
            self.virtual_size = size
        self.refresh()

    def select(self, key: Any) -> None:
        """Select a row by its key, and scroll to it; unknown keys are ignored."""
        if key in self.keys:
            self._go(self.keys.index(key))

    def action_move(self, rows: int) -> None:
        """Move down by some rows; negative numbers move up."""
        self._go(self._at + rows)

    def action_page(self, pages: int) -> None:
        """Move down by some screens; negative numbers move up."""
        self._go(self._at + pages * max(self.size.height - 1, 1))

    def on_click(self, event: Click) -> None:
        """Select the row that is clicked."""
        self._go(event.y + self.scroll_offset.y)

    def _go(self, row: int) -> None:
        if not self.keys:
            return
        before, self._at = self._at, min(max(row, 0), len(self.keys) - 1)
        top, height = self.scroll_offset.y, max(self.size.height, 1)
        if not top <= self._at < top + height:
            self.scroll_to(y=self._at - height // 2, animate=False)
        self.refresh()
        if self._at != before:
            self.post_message(self.Selected(self, self.selected))

    def render_line(self, y: int) -> Strip:
        """Draw a line on screen; the selected row has a sign, and is reversed if it has the
        focus.
        """
        row, width = y + self.scroll_offset.y, self.size.width
        if row >= len(self._texts):
            return Strip.blank(width, self.rich_style)
        is_selected = row == self._at
        text = Text("›" if is_selected else " ", no_wrap=True, end="")
        text.append_text(self._texts[row])
        strip = Strip(text.render(self.app.console)).adjust_cell_length(width)
        strip = strip.apply_style(self.rich_style)
        return strip.apply_style(Style(reverse=True)) if is_selected and self.has_focus else strip

    def on_focus(self) -> None:
        """Redraw, since the selected row looks different with the focus."""
        self.refresh()

    def on_blur(self) -> None:
        """Redraw, as `on_focus`."""
        self.refresh()
