"""Reports errors of this program that occur in a connection or a request.

The first error of a kind is shown with its traceback, later ones are only counted, so that a server
that repeats a request does not fill the log.
"""

from __future__ import annotations

import traceback
from collections import Counter

import click

# A count is reported when it reaches one of these.
WARNED_AT = (1, 10, 100, 1_000, 10_000, 100_000, 1_000_000)


class OwnErrors:
    """Reports to stderr. Errors of the same type from the same line of code are of one kind."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._counts: Counter[tuple[type[BaseException], str, int]] = Counter()

    def report(self, error: Exception) -> None:
        """Report an error of this program that was caught."""
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
