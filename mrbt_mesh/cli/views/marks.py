"""Signs and styles of statuses and states; no meaning depends on a colour alone."""

from __future__ import annotations

from collections.abc import Mapping

from rich.text import Text

from mrbt_mesh.core.bt.tree import Status

MARKS = {
    Status.IDLE: ("·", "dim"),
    Status.RUNNING: ("▶", "bold cyan"),
    Status.SUCCESS: ("✔", "green"),
    Status.FAILURE: ("✘", "red"),
}
# Of robots; the words are those of `TeamView`.
STATE_MARKS = {
    "alive": ("●", "green"),
    "joining": ("◌", "cyan"),
    "suspect": ("?", "yellow"),
    "leaving": ("◐", "yellow"),
    "dead": ("✖", "bold red"),
    "left": ("○", "dim"),
}
# By `WorkEnd`. A death has a mark of its own.
END_MARKS = {"done": ("✔", "green"), "failed": ("✘", "red"), "dropped": ("↷", "yellow")}
# Of a headline's statements, by `Level`.
LEVEL_MARKS = {
    "bad": ("✘", "bold red"),
    "warn": ("!", "yellow"),
    "info": ("·", "cyan"),
    "good": ("✔", "green"),
}


def statement_text(statement: Mapping[str, str]) -> Text:
    """A statement of a headline, as plain data, with its sign and colour."""
    sign, style = LEVEL_MARKS[statement["level"]]
    return Text(f"{sign} {statement['text']}", style)
