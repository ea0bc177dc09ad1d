"""Errors of this program that a connection or a request meets.

The first of a kind is shown with its traceback, the others are counted, so that a server that asks
again and again fills no log.
"""

from __future__ import annotations

import traceback
from collections import Counter

import click

# A count is said when it reaches one of these.
WARNED_AT = (1, 10, 100, 1_000, 10_000, 100_000, 1_000_000)


class OwnErrors:
    """Reports on stderr. Errors of one type that come from one line of code are one kind."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._counts: Counter[tuple[type[BaseException], str, int]] = Counter()

    def report(self, error: Exception) -> None:
        """Say that an error of this program has been caught."""
        raised = traceback.extract_tb(error.__traceback__)[-1:]
        file, line = next(((at.filename, at.lineno or 0) for at in raised), ("", 0))
        kind = type(error), file, line
        self._counts[kind] += 1
        count = self._counts[kind]
        if count == 1:
            click.echo("".join(traceback.format_exception(error)), err=True, nl=False)
        if count in WARNED_AT:
            text = (
                f"{self._name}: an error of mrbt serve, number {count} of its kind: {error!r:.200}"
            )
            click.echo(text.encode("ascii", "backslashreplace").decode(), err=True)
