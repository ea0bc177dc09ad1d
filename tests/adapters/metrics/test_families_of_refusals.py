"""Reasons of refusals come in few classes, whatever strangers send."""

from __future__ import annotations

import ast
from collections.abc import Iterator

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.adapters.metrics.families import (
    MALFORMED,
    OTHER,
    REASONS,
    reason_class,
    refusals_by_class,
)
from mrbt_mesh.core.membership.keys import NOT_AUTHENTIC
from tests.support.build import action, make_mission, sequence
from tests.support.paths import ROOT

MISSION = make_mission(sequence(action("weld")), {"A": {"weld": 1}, "B": {"weld": 1}})
SOURCES = ("core/membership", "runtime/flood_gate.py")


def refusing_texts() -> Iterator[str]:
    """All texts with which the code refuses messages, with `*` for what they quote."""
    for name in SOURCES:
        path = ROOT / "mrbt_mesh" / name
        for file in sorted(path.glob("*.py")) if path.is_dir() else [path]:
            for node in ast.walk(ast.parse(file.read_text())):
                if isinstance(node, ast.Call) and getattr(node.func, "id", "").endswith("Error"):
                    yield from map(_text, node.args[:1])
                elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                    yield node.value


def _text(node: ast.expr) -> str:
    parts = node.values if isinstance(node, ast.JoinedStr) else [node]
    return "".join(
        str(part.value) if isinstance(part, ast.Constant) else "'*'" for part in parts
    ).replace("''", "'")


@pytest.mark.parametrize("name", [each for each in REASONS if each != MALFORMED])
def test_every_class_has_reasons_that_the_code_gives(name: str) -> None:
    assert name in set(map(reason_class, refusing_texts()))


@pytest.mark.parametrize(
    ("reason", "expected"),
    [
        ("too much to check", "flood"),
        ("said before", "replayed"),
        ("late: 256 messages of its sender overtook it", "late"),
        ("a life of op from before 256 others: it has to take a later one", "stale"),
        ("meant for an earlier life of A", "stale"),
        ("meant for somebody else", "misdirected"),
        ("not signed", "unsigned"),
        (NOT_AUTHENTIC, "forged"),
        ("signature is wrong", "forged"),
        ("sent by B under the name of A", "forged"),
        ("B published entries of another author", "forged"),
        ("run 'other' (ours is 'r')", "incompatible"),
        ("mission 'm' with digest 12 (ours is 'n', 34): all robots ...", "incompatible"),
        ("wire schema 3 (ours is 4)", "incompatible"),
        ("beat is malformed", "malformed"),
        ("anything else", "malformed"),
    ],
)
def test_reasons(reason: str, expected: str) -> None:
    assert reason_class(reason) == expected


@given(st.dictionaries(st.text(max_size=40), st.integers(1, 9), max_size=30))
def test_labels_stay_few_and_none_is_lost(refused: dict[str, int]) -> None:
    found = refusals_by_class(MISSION, refused)
    assert sum(found.values()) == sum(refused.values())
    for source, reason in found:
        assert source in {"A", "B", OTHER}
        assert reason in {*REASONS, OTHER}


def test_sources_of_the_mission_have_names() -> None:
    refused = {"B: said before": 2, "X: said before": 1, "others: too many to tell apart": 4}
    found = refusals_by_class(MISSION, refused)
    assert found == {("B", "replayed"): 2, (OTHER, "replayed"): 1, (OTHER, MALFORMED): 4}
