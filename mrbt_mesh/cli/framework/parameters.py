"""Options and arguments that know all that the help screen tells of them."""

from __future__ import annotations

from typing import Any

import click


class Option(click.Option):
    """An option, and the panel of the help in which it is listed (None: the usual one)."""

    def __init__(self, declarations: list[str], panel: str | None, **settings: Any) -> None:
        super().__init__(declarations, **settings)
        self.panel = panel


class Argument(click.Argument):
    """An argument with a text for the help screen."""

    def __init__(self, name: str, text: str, **settings: Any) -> None:
        super().__init__([name], **settings)
        self.text = text
