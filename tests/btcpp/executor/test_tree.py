"""A tree as a program uses it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from mrbt_mesh.adapters.btcpp_trees import TREES
from mrbt_mesh.btcpp import BehaviorTree, Leaves, NodeStatus, check
from mrbt_mesh.errors import FileError
from tests.support.btcpp.running import in_virtual_time
from tests.support.paths import ROOT

TWO = (
    '<root BTCPP_format="4"><BehaviorTree ID="Go"><AlwaysSuccess/></BehaviorTree>'
    '<BehaviorTree ID="Stay"><AlwaysFailure/></BehaviorTree></root>'
)


def test_a_file_with_what_it_includes(tmp_path: Path) -> None:
    (tmp_path / "inner.xml").write_text(
        '<root BTCPP_format="4"><BehaviorTree ID="In"><Go to="{to}"/></BehaviorTree></root>'
    )
    (tmp_path / "outer.xml").write_text(
        '<root BTCPP_format="4" main_tree_to_execute="Main"><include path="inner.xml"/>'
        '<BehaviorTree ID="Main"><SubTree ID="In" to="dock"/></BehaviorTree></root>'
    )
    tree = BehaviorTree.from_file(tmp_path / "outer.xml")
    went: list[str] = []

    @tree.action("Go")
    def go(to: str) -> None:
        went.append(to)

    assert in_virtual_time(tree.run)[0] is NodeStatus.SUCCESS
    assert went == ["dock"]
    assert [(view.depth, view.path) for view in tree.view()] == [(0, "Main/In"), (1, "Main/In/Go")]


def test_which_tree() -> None:
    assert in_virtual_time(BehaviorTree.from_text(TWO, "Stay").run)[0] is NodeStatus.FAILURE
    with pytest.raises(FileError, match=r"main_tree_to_execute names none.*Go, Stay"):
        BehaviorTree.from_text(TWO)
    with pytest.raises(FileError, match=r"no tree 'Stya'; did you mean 'Stay'"):
        BehaviorTree.from_text(TWO, "Stya")
    with pytest.raises(FileError, match=r"exactly one child|children"):
        BehaviorTree.from_text('<root><BehaviorTree ID="A"/></root>').check()


INCLUDED = (
    '<root BTCPP_format="4" main_tree_to_execute="In"><BehaviorTree ID="In"><AlwaysFailure/>'
    "</BehaviorTree></root>"
)
INCLUDE = '<include path="inner/inner.xml"/>'
MAIN = '<BehaviorTree ID="Main"><AlwaysSuccess/></BehaviorTree>'
OTHER = '<BehaviorTree ID="Other"><SubTree ID="Main"/></BehaviorTree>'
IN = '<BehaviorTree ID="In"><AlwaysSuccess/></BehaviorTree>'


@pytest.mark.parametrize(
    ("attribute", "trees", "chosen"),
    [
        ("", INCLUDE + MAIN, "Main"),
        ("", INCLUDE, "In"),
        ("", INCLUDE + IN, "In"),
        ("", MAIN, "Main"),
        ('main_tree_to_execute="In"', INCLUDE + MAIN, "In"),
        ('main_tree_to_execute=""', MAIN, "Main"),
        ('main_tree_to_execute=""', INCLUDE + MAIN, None),
        ('main_tree_to_execute="No"', MAIN, None),
        ("", MAIN + OTHER, None),
        ("", INCLUDE + MAIN + OTHER, None),
    ],
)
def test_the_main_tree_is_the_one_of_the_library(
    attribute: str, trees: str, chosen: str | None, tmp_path: Path
) -> None:
    """BehaviorTree.CPP 4.10.0 chose these; None: it did not load the file."""
    (tmp_path / "inner").mkdir()
    (tmp_path / "inner" / "inner.xml").write_text(INCLUDED)
    file = tmp_path / "main.xml"
    file.write_text(f'<root BTCPP_format="4" {attribute}>{trees}</root>')
    is_refused = "root" in [each.problem.path for each in check(file, is_strict=True)]
    assert is_refused is (chosen is None)
    if chosen is None:
        with pytest.raises(FileError, match="name one of"):
            BehaviorTree.from_file(file)
        with pytest.raises(FileError):
            TREES.read(file, "")
        return
    assert BehaviorTree.from_file(file).name == chosen
    assert BehaviorTree.from_text(file.read_text(), file=file).name == chosen
    xml, tree = TREES.read(file, "")
    assert tree == chosen
    # Of two trees of the same ID the including file's counts; one document keeps the main tree.
    merged = BehaviorTree.from_text(xml)
    is_included = chosen == "In" and IN not in trees
    ends = NodeStatus.FAILURE if is_included else NodeStatus.SUCCESS
    assert merged.name == chosen
    assert in_virtual_time(merged.run)[0] is ends
    assert in_virtual_time(BehaviorTree.from_file(file).run)[0] is ends


def test_a_text_includes_files_relative_to_where_it_is_from(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "inner").mkdir()
    (tmp_path / "inner" / "inner.xml").write_text(INCLUDED)
    text = f'<root BTCPP_format="4">{INCLUDE}<BehaviorTree ID="M"><SubTree ID="In"/></BehaviorTree>'
    text += "</root>"
    with pytest.raises(FileError, match=r"no tree 'In'; it may be in inner/inner\.xml, which was"):
        BehaviorTree.from_text(text).check()
    BehaviorTree.from_text(text, file=tmp_path / "not_there.xml").check()
    monkeypatch.chdir(tmp_path)
    BehaviorTree.from_text(text).check()


def test_leaves_may_be_shared_by_trees() -> None:
    leaves = Leaves()
    leaves.action("Go")(lambda: None)
    text = '<root BTCPP_format="4"><BehaviorTree ID="A"><Go/></BehaviorTree></root>'
    for _ in range(2):
        tree = BehaviorTree.from_text(text, leaves=leaves)
        assert in_virtual_time(tree.run)[0] is NodeStatus.SUCCESS


def test_the_blackboard_stays_from_run_to_run() -> None:
    text = (
        '<root BTCPP_format="4"><BehaviorTree ID="A"><Script code="n += 1"/></BehaviorTree></root>'
    )
    tree = BehaviorTree.from_text(text)
    tree.blackboard["n"] = 0
    for _ in range(3):
        in_virtual_time(tree.run)
    assert tree.blackboard["n"] == 3


def test_the_example_of_the_documentation_runs(capsys: pytest.CaptureFixture[str]) -> None:
    page = (ROOT / "docs" / "how-to" / "robot-trees.md").read_text(encoding="utf-8")
    code = page.split("```python\n", 1)[1].split("```", 1)[0]
    names: dict[str, Any] = {"__name__": "example"}
    before, after = code.split("status = anyio.run(tree.run)\n")
    exec(before, names)
    status, took_s = in_virtual_time(names["tree"].run)
    exec(after, names | {"status": status})
    assert capsys.readouterr().out == "SUCCESS shelf 3\n"
    assert took_s == 3.0
