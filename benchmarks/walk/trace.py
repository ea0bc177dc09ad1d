"""Which of the product's files are entered, and how often one goes on in another: sys.setprofile.

Imports nothing of the product, so that a command can be traced from its first import on.
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from types import CodeType, FrameType
from typing import Any, NamedTuple

PRODUCT = f"{Path(__file__).resolve().parents[2] / 'mrbt_mesh'}/"
# The code of a module and of its classes' bodies runs when it is imported.
_IMPORT = "<module>"


class Landing(NamedTuple):
    """Where a call or a return leads to: in which robot, in which of its steps, in which file."""

    robot: str
    step: int
    file: str


@dataclass
class Trace:
    """Where the program was, one landing after the other; files are relative to mrbt_mesh/.

    A call lands in the called function's file, a return in its caller's. Calls of generated code
    and of other libraries do not count, nor does what happens while a module is imported.
    """

    landings: list[Landing] = field(default_factory=list)

    def of(self, robot: str) -> Trace:
        """What one robot did."""
        return Trace([each for each in self.landings if each.robot == robot])

    def first_step(self) -> Trace:
        """The step with which it begins."""
        return Trace([each for each in self.landings if each.step == self.landings[0].step])

    def within(self, folder: str) -> Trace:
        """The part of it in one folder, such as `core/`."""
        return Trace([each for each in self.landings if each.file.startswith(folder)])

    def files(self) -> Counter[str]:
        """File -> how often one came to it, in the order in which they were first entered."""
        found: Counter[str] = Counter()
        before = None
        for _, _, file in self.landings:
            found[file] += file != before
            before = file
        return found

    def jumps(self) -> Counter[tuple[str, str]]:
        """(From this file, to that one) -> how often."""
        steps = pairwise(each.file for each in self.landings)
        return Counter((one, other) for one, other in steps if one != other)

    def figures(self) -> dict[str, Any]:
        """What is counted, as data; an edge leads from one file to another, however often."""
        jumps = self.jumps()
        between = sum(n for (a, b), n in jumps.items() if package(a) != package(b))
        return {
            "files": len(self.files()),
            "packages": len({package(file) for file in self.files()}),
            "edges": len(jumps),
            "jumps": sum(jumps.values()),
            "jumps_between_packages": between,
        }

    def entries_from_elsewhere(self, name: str) -> int:
        """How often one came to a file of this name from another one."""
        jumps = self.jumps().items()
        return sum(count for (_, file), count in jumps if file.rpartition("/")[2] == name)


def package(file: str) -> str:
    """`core/agent` of core/agent/agent.py; a folder further down belongs to the one above it."""
    folders = file.split("/")[:-1]
    return "/".join(folders[:2])


def begin(steps: Iterable[CodeType] = ()) -> Trace:
    """Trace what follows until `end`: what is called from these methods, by robot (`self.me`).

    Without `steps` everything.
    """
    trace = Trace()
    sys.setprofile(_Recorder(trace, frozenset(steps)))
    return trace


def end() -> None:
    sys.setprofile(None)


class _Recorder:
    def __init__(self, trace: Trace, steps: frozenset[CodeType]) -> None:
        self._land = trace.landings.append
        self._steps = steps
        self._robot: str | None = None if steps else ""
        self._step = 0
        self._outermost: FrameType | None = None
        self._imports = 0

    def __call__(self, frame: FrameType, event: str, _: Any) -> None:
        code = frame.f_code
        if event == "call":
            if code.co_name == _IMPORT:
                self._imports += 1
            if code in self._steps and self._outermost is None:
                self._robot, self._outermost = frame.f_locals["self"].view.robot, frame
                self._step += 1
            self._come_to(code)
        elif event == "return":
            if code.co_name == _IMPORT:
                self._imports -= 1
            if frame is self._outermost:
                self._robot = self._outermost = None
            elif frame.f_back is not None:
                self._come_to(frame.f_back.f_code)

    def _come_to(self, code: CodeType) -> None:
        file = code.co_filename
        if self._robot is not None and not self._imports and file.startswith(PRODUCT):
            self._land(Landing(self._robot, self._step, file[len(PRODUCT) :]))
