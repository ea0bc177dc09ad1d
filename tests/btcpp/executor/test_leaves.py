"""Functions as leaves: their ports by their parameters."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from mrbt_mesh.btcpp import InOut, LeafError, Leaves, Out, TreeNode
from mrbt_mesh.btcpp.executor.controls import Reactive
from mrbt_mesh.btcpp.executor.leaves import LeafPort, leaf_of
from mrbt_mesh.btcpp.files.document import Category


def test_ports_have_the_types_of_the_parameters() -> None:
    async def work(
        name: str,
        count: int,
        share: float,
        on: bool,
        path: list[float],
        thing: Any = None,
        **more: Any,
    ) -> None: ...

    leaf = leaf_of("Work", Category.ACTION, work)
    assert {name: port.type for name, port in leaf.ports.items()} == {
        "name": "std::string",
        "count": "int64_t",
        "share": "double",
        "on": "bool",
        "path": "list<double>",
        "thing": "",
    }
    assert leaf.ports["thing"].is_optional
    assert leaf.takes_others
    assert leaf.is_async


def test_outputs() -> None:
    def work(
        found: Out[str],
        count: InOut[int],
        extra: Out[Any],
        error: Out[int] | None = None,
        either: int | str = 1,
    ) -> None: ...

    leaf = leaf_of("Work", Category.ACTION, work)
    assert leaf.ports == {
        "found": LeafPort("std::string", reads=False, writes=True),
        "count": LeafPort("int64_t", reads=True, writes=True),
        "extra": LeafPort("", reads=False, writes=True),
        "error": LeafPort("int64_t", reads=False, writes=True, is_optional=True),
        "either": LeafPort("", is_optional=True),
    }
    assert not leaf.is_async


def test_what_the_program_says() -> None:
    leaves = Leaves(Path)

    @leaves.entry("@charge")
    def charge(where: Path) -> int:
        return 1

    assert leaves.entries.keys() == {"charge"}
    for wrong in (lambda port: 1, _waits):
        with pytest.raises(LeafError, match="a plain function without ports is expected"):
            leaves.entry("other")(wrong)
    with pytest.raises(LeafError, match="the entry 'charge' is registered twice"):
        leaves.entry("charge")(lambda: 1)


async def _waits() -> None: ...


def test_one_for_all_types() -> None:
    leaves = Leaves()

    @leaves.action("*")
    def anything(kind: str, /, **ports: Any) -> None: ...

    @leaves.condition("Ok")
    def ok() -> bool:
        return True

    found = leaves.find("Whatever")
    assert found is not None
    assert (found.takes_type, found.category) == (True, Category.ACTION)
    named = leaves.find("Ok")
    assert named is not None
    assert named.category is Category.CONDITION


@pytest.mark.parametrize(
    ("function", "message"),
    [
        (3, "the leaf 'A': 3 is not a function"),
        (Leaves, "is not a function"),
        (lambda *ports: None, r"the leaf 'A': \*ports cannot be a port"),
    ],
)
def test_what_cannot_be_a_leaf(function: Any, message: str) -> None:
    with pytest.raises(LeafError, match=message):
        Leaves().action("A")(function)


def test_annotations_that_cannot_be_read() -> None:
    def work(what: Nowhere) -> None: ...  # type: ignore[name-defined]  # noqa: F821

    with pytest.raises(LeafError, match="annotations cannot be read: name 'Nowhere'"):
        Leaves().action("A")(work)


def test_a_type_is_registered_once() -> None:
    leaves = Leaves()
    leaves.action("A")(lambda: None)
    with pytest.raises(LeafError, match="'A' is registered twice"):
        leaves.condition("A")(lambda: None)
    with pytest.raises(LeafError, match="needs a name"):
        leaves.action("")
    leaves.node("N")(Reactive)
    with pytest.raises(LeafError, match="'N' is registered twice"):
        leaves.node("N")(Reactive)
    with pytest.raises(LeafError, match="TreeNode has no method tick"):
        leaves.node("M")(TreeNode)
    with pytest.raises(LeafError, match="is not a subclass of TreeNode"):
        leaves.node("M")(dict)  # type: ignore[type-var]
    assert leaves.names() == ["A", "N"]
