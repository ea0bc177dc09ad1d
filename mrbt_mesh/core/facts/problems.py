"""What a robot's own program does wrong, as that robot tells its team; only people read it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from mrbt_mesh.core.facts.values import Record, read_text
from mrbt_mesh.core.mission.failure_reasons import MAX_REASON

MAX_SUBJECT = 100


@dataclass(frozen=True, slots=True)
class ProgramProblem(Record):
    """The newest problem with one part of the author's program: its bid, a function, the loop."""

    text: str

    @staticmethod
    def parse(value: Any) -> ProgramProblem:
        return ProgramProblem(read_text(value, MAX_REASON))


def as_subject(text: str) -> str:
    """What a problem is about, as it stands in the fact's name."""
    name = "".join(sign if sign.isprintable() and sign != "/" else "_" for sign in text)
    return name[:MAX_SUBJECT] or "_"
