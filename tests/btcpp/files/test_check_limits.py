"""Large files: checking stays quick, stops at a number of findings, and says so."""

from __future__ import annotations

import pytest

from mrbt_mesh.btcpp.files.check import check_library
from mrbt_mesh.btcpp.files.document import parse_document
from mrbt_mesh.btcpp.files.export import with_ids
from mrbt_mesh.btcpp.files.findings import MAX_FINDINGS, Findings
from mrbt_mesh.btcpp.files.library import Library, library_of
from mrbt_mesh.errors import FileError


def checked(trees: dict[str, str]) -> tuple[Library, Findings]:
    body = "".join(f'<BehaviorTree ID="{k}">{inner}</BehaviorTree>' for k, inner in trees.items())
    text = f'<root BTCPP_format="4" main_tree_to_execute="T0">{body}</root>'
    findings = Findings()
    library = library_of(parse_document(text, "m.xml"), findings)
    check_library(library, findings)
    return library, findings


def test_many_trees_that_all_refer_to_nothing() -> None:
    _, findings = checked({f"T{n}": f'<SubTree ID="Missing{n}"/>' for n in range(20_000)})
    assert findings.is_full
    assert len(findings.warnings) == MAX_FINDINGS


def test_a_chain_that_comes_back_to_every_tree() -> None:
    count = 5_000
    trees = {
        f"T{n}": f'<Sequence><SubTree ID="T{n + 1}"/><SubTree ID="T0"/></Sequence>'
        for n in range(count)
    }
    _, findings = checked({**trees, f"T{count}": "<AlwaysSuccess/>"})
    assert len(findings.errors) == MAX_FINDINGS
    assert max(len(str(error)) for error in findings.errors) < 300


def test_one_tree_with_many_references() -> None:
    references = '<SubTree ID="T1"/>' * 50_000
    _, findings = checked({"T0": f"<Sequence>{references}</Sequence>", "T1": "<AlwaysSuccess/>"})
    assert not findings.in_order()


def test_each_tree_of_a_diamond_is_looked_at_once() -> None:
    trees = {
        f"T{n}": f'<Sequence><SubTree ID="T{n + 1}"/><SubTree ID="T{n + 1}"/></Sequence>'
        for n in range(60)
    }
    library, findings = checked({**trees, "T60": "<AlwaysSuccess/>"})
    assert not findings.in_order()
    with pytest.raises(FileError, match="more than 20000 nodes"):
        with_ids(library)


def test_numbering_refuses_recursion() -> None:
    library, findings = checked({"T0": '<SubTree ID="T0"/>'})
    assert len(findings.errors) == 1
    with pytest.raises(FileError, match="cannot contain itself"):
        with_ids(library)
