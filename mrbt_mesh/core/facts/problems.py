"""What is wrong with a robot's program or journal, as that robot tells its team, for people."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from mrbt_mesh.core.facts.values import Record, read_text
from mrbt_mesh.core.mission.failure_reasons import MAX_REASON

MAX_SUBJECT = 100
# The subject of what is wrong with the journal; all others are parts of the program.
JOURNAL = "journal"


@dataclass(frozen=True, slots=True)
class RobotProblem(Record):
    """The newest problem with the author's journal, or with one part of its program: its bid, a
    function, the loop. Empty: there is none any more.
    """

    text: str

    @staticmethod
    def parse(value: Any) -> RobotProblem:
        return RobotProblem(read_text(value, MAX_REASON))


def problem_text(subject: str, text: str) -> str:
    """A problem in words."""
    return text if subject == JOURNAL else f"program problem, {subject}: {text}"


def as_subject(text: str) -> str:
    """What a problem is about, as it stands in the fact's name."""
    name = "".join(sign if sign.isprintable() and sign != "/" else "_" for sign in text)
    return name[:MAX_SUBJECT] or "_"
