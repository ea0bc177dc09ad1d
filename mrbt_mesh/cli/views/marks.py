"""Signs and styles of statuses and states; no meaning depends on a colour alone."""

from __future__ import annotations

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
