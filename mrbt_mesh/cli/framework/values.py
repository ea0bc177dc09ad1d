"""Values on the command line: texts and paths with something in them, numbers within bounds.

No float may be beyond a thousand million, so that none overflows where it is turned into others.
"""

from __future__ import annotations

import errno
import math
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click

LARGEST = 1_000_000_000.0


@dataclass(frozen=True)
class NumberBounds:
    """`least` and `most` may be reached, `above` may not; values are multiples of `step`."""

    least: float | None = None
    most: float | None = None
    above: float | None = None
    step: float | None = None

    def __str__(self) -> str:
        """What is expected, for the help; empty without bounds."""
        if self.least is not None:
            more = "or more" if self.most is None else f"to {self.most:g}"
            return f"{self.least:g} {more}"
        texts = []
        if self.above is not None:
            texts.append(f"above {self.above:g}")
        if self.most is not None:
            texts.append(f"at most {self.most:g}")
        return ", ".join(texts)

    def hold(self, number: float) -> bool:
        """Whether a number keeps the bounds."""
        if self.least is not None and number < self.least:
            return False
        if self.above is not None and number <= self.above:
            return False
        if self.most is not None and number > self.most:
            return False
        if self.step is None:
            return True
        steps = number / self.step
        return math.isclose(steps, round(steps), rel_tol=1e-9, abs_tol=1e-9)


class TextType(click.ParamType[str]):
    """A text that is not empty."""

    name = "text"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        if not str(value).strip():
            self.fail(f"{value!r} is empty", param, ctx)
        return str(value)


class PathType(click.ParamType[Path]):
    """A path, of something that is there or not."""

    name = "path"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Path:
        if not str(value).strip():
            self.fail(f"{value!r} is no path", param, ctx)
        try:
            os.lstat(value)
        except ValueError as error:
            self.fail(f"{value!r} is no path: {error}", param, ctx)
        except OSError as error:
            if error.errno == errno.ENAMETOOLONG:
                self.fail(f"{value}: the name is too long", param, ctx)
        return Path(value)


class NumberType(click.ParamType[Any]):
    """A finite int or float within bounds."""

    def __init__(self, kind: type[int] | type[float], bounds: NumberBounds) -> None:
        self.name = "integer" if kind is int else "number"
        self.bounds = bounds
        self._kind = kind

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> int | float:
        try:
            number = self._kind(value)
        except ValueError:
            number = math.nan
        is_usable = math.isfinite(number) and (self._kind is int or abs(number) <= LARGEST)
        if not is_usable or not self.bounds.hold(number):
            self.fail(f"{value}: expected {self._expected()}", param, ctx)
        return number

    def _expected(self) -> str:
        texts = ["a whole number" if self._kind is int else "a number"]
        if str(self.bounds):
            texts.append(str(self.bounds))
        if self.bounds.step is not None:
            texts.append(f"in steps of {self.bounds.step:g}")
        if self._kind is float and self.bounds.most is None:
            texts.append(f"at most {LARGEST:.0f}")
        return ", ".join(texts)
