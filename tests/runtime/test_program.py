"""What a program may say of its robot's capabilities."""

from __future__ import annotations

import re
from typing import Any

import pytest

from tests.support.fake_port import FakePort, context

OWN = ("carry(red)", "carry(green)", "scan")


class Told(FakePort):
    """Keeps what a program says of capabilities."""

    def __init__(self) -> None:
        super().__init__()
        self.said: list[tuple[Any, ...]] = []

    def lose_capability(self, local_task: str, reason: str, is_watched: bool = False) -> None:
        self.said.append(("lose", local_task))

    def restore_capability(self, local_task: str) -> None:
        self.said.append(("restore", local_task))

    def report_performance(self, local_task: str, performance: float) -> None:
        self.said.append(("perform", local_task, performance))


@pytest.mark.parametrize("name", ["carry", "carry(red)", "scan"])
def test_a_type_and_a_ground_local_task_of_the_robot_are_passed_on(name: str) -> None:
    port = Told()
    task = context(port, "scan", capabilities=OWN)
    task.lose_capability(name)
    task.restore_capability("all")
    task.report_performance(name, 0.5)
    assert port.said == [("lose", name), ("restore", "all"), ("perform", name, 0.5)]
    assert task.can(name)


@pytest.mark.parametrize(
    ("name", "hint"),
    [
        ("crry", "; did you mean 'carry'?"),
        ("drive", "; known: "),
        ("", "; known: "),
        (3, "; known: "),
        ("everything", "; known: "),
    ],
)
def test_a_local_task_that_the_robot_does_not_have_is_refused(name: Any, hint: str) -> None:
    port = Told()
    task = context(port, "scan", capabilities=OWN)
    for tell in (
        task.lose_capability,
        task.restore_capability,
        lambda name: task.report_performance(name, 0.5),
    ):
        with pytest.raises(ValueError, match=re.escape(f"A1 has no local task {name!r}{hint}")):
            tell(name)
    with pytest.raises(ValueError, match="has no local task 'all'"):
        task.report_performance("all", 0.5)
    assert port.said == []
