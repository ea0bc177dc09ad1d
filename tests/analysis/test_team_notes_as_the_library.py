"""What is said of actions in a condition is what BehaviorTree.CPP itself does."""

from __future__ import annotations

from typing import Any

import pytest

from mrbt_mesh.analysis.team_tree import to_team_tree
from mrbt_mesh.btcpp.files.document import Category, parse_document
from mrbt_mesh.btcpp.files.findings import Findings
from mrbt_mesh.btcpp.files.library import library_of
from tests.support.real_btcpp import INSTALL

# (tree, whether A is begun again while B runs)
TREES = [
    ("<WhileDoElse><A/><B/></WhileDoElse>", False),
    ("<WhileDoElse><Sequence><A/></Sequence><B/></WhileDoElse>", True),
    ("<WhileDoElse><Inverter><A/></Inverter><AlwaysSuccess/><B/></WhileDoElse>", True),
    ("<WhileDoElse><ForceSuccess><A/></ForceSuccess><B/></WhileDoElse>", True),
    ("<ReactiveSequence><A/><B/></ReactiveSequence>", True),
    ("<ReactiveFallback><Inverter><A/></Inverter><B/></ReactiveFallback>", True),
    ("<Sequence><A/><B/></Sequence>", False),
]


def document(body: str) -> str:
    return f'<root BTCPP_format="4"><BehaviorTree ID="M">{body}</BehaviorTree></root>'


def begun(body: str) -> int:
    """How often A is begun in eight ticks: it succeeds after one, and B runs on."""
    btcpp: Any = pytest.importorskip("behaviortreepy", reason=INSTALL)
    status = btcpp.NodeStatus
    starts: list[Any] = []
    factory = btcpp.BehaviorTreeFactory()

    def start(node: Any) -> Any:
        starts.append(node)
        return status.RUNNING

    factory.register_simple_stateful_action("A", start, lambda _: status.SUCCESS)
    running = (lambda _: status.RUNNING,) * 2
    factory.register_simple_stateful_action("B", *running)
    tree = factory.create_tree_from_text(document(body))
    for _ in range(8):
        tree.tick_exactly_once()
    return len(starts)


@pytest.mark.parametrize(("body", "is_begun_again"), TREES)
def test_it_begins_the_action_again(body: str, is_begun_again: bool) -> None:
    assert (begun(body) > 1) is is_begun_again


@pytest.mark.parametrize(("body", "is_begun_again"), TREES)
def test_a_note_says_so_and_only_then(body: str, is_begun_again: bool) -> None:
    library = library_of(parse_document(document(body), "m.xml"), Findings())
    notes = to_team_tree(library, "M", Category.ACTION).notes
    assert any("is begun again" in note.message for note in notes) is is_begun_again
    if "While" in body and is_begun_again:
        assert "inside its condition" in notes[0].message
