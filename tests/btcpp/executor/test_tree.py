"""A tree as a program uses it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from mrbt_mesh.btcpp import BehaviorTree, Leaves, NodeStatus
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
