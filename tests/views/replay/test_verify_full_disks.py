"""A robot that says that it does not record has lied in nothing that it said afterwards."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import pytest

from mrbt_mesh.core.facts.store import Incarnation, Version
from mrbt_mesh.views.replay import verify
from mrbt_mesh.views.replay.checked_recording import RecordedFact

LIFE = Incarnation(1, "n")


class Check:
    """The facts of one recording, and what is found."""

    def __init__(self, robot: str, *facts: tuple[str, str, int]) -> None:
        self.recording = SimpleNamespace(
            metadata=SimpleNamespace(robot=robot), name=f"{robot}.mcap", damage=()
        )
        self.begins_after = None
        self.found: list[str] = []
        self.facts = [
            RecordedFact(number, number, author, name, Version(LIFE, version), version, b"")
            for number, (author, name, version) in enumerate(facts, start=1)
        ]

    def add(self, _: RecordedFact, text: str, against: object) -> None:
        self.found.append(text)


def found(monkeypatch: pytest.MonkeyPatch, *checks: Check) -> list[str]:
    monkeypatch.setattr(verify, "lives", lambda _: [LIFE])
    verify._missing(cast(Any, checks))
    return [text for check in checks for text in check.found]


def test_what_came_after_its_disk_was_full_is_not_missed(monkeypatch: pytest.MonkeyPatch) -> None:
    own = Check("A", ("A", "member", 1), ("A", "claim", 3))
    other = Check("B", ("A", "member", 1), ("A", "claim", 3), ("A", "outcome", 4))
    assert found(monkeypatch, own, other) == ["A has not recorded its outcome"]
    own.found, other.found = [], []
    other = Check("B", *[(f.author, f.name, f.version.sequence) for f in other.facts])
    other.facts.append(other.facts[-1]._replace(name="problem/recording", version=Version(LIFE, 5)))
    assert found(monkeypatch, own, other) == []


def test_what_was_taken_out_of_the_middle_is_still_missed(monkeypatch: pytest.MonkeyPatch) -> None:
    own = Check("A", ("A", "member", 1), ("A", "claim", 3))
    other = Check("B", ("A", "member", 1), ("A", "outcome", 2), ("A", "problem/recording", 4))
    assert found(monkeypatch, own, other) == ["A has not recorded its outcome"]
