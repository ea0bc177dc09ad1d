"""The overview is short and true: its pictures, and the index of decisions."""

from __future__ import annotations

import re
import tomllib
from itertools import pairwise
from typing import Any

from tests.support.paths import ROOT

ARCHITECTURE = (ROOT / "ARCHITECTURE.md").read_text(encoding="utf-8")
PICTURES = re.findall(r"^```mermaid\n(.*?)^```", ARCHITECTURE, re.DOTALL | re.MULTILINE)
MOST_WORDS = 1_500
_ARROW = re.compile(r"^ *(\w+(?: & \w+)*) --> (\w+(?: & \w+)*)$", re.MULTILINE)


def layers_of(contract: dict[str, Any]) -> list[frozenset[str]]:
    """The names in each layer of a contract, from the top."""
    return [
        frozenset(name.strip().removeprefix("mrbt_mesh.") for name in layer.split("|"))
        for layer in contract["layers"]
    ]


def test_it_is_short() -> None:
    assert len(ARCHITECTURE.split()) < MOST_WORDS


def test_the_picture_has_the_layers_that_the_contracts_keep() -> None:
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    contracts = [
        contract
        for contract in settings["tool"]["importlinter"]["contracts"]
        if contract["type"] == "layers"
        and contract.get("containers", ["mrbt_mesh.core"]) == ["mrbt_mesh.core"]
    ]
    assert len(contracts) == 2
    kept = {step for contract in contracts for step in pairwise(layers_of(contract))}
    drawn = {
        (frozenset(upper.split(" & ")), frozenset(lower.split(" & ")))
        for upper, lower in _ARROW.findall(PICTURES[0])
    }
    assert drawn == kept


def test_the_files_in_the_pictures_exist() -> None:
    named = set(re.findall(r"\w+\.py", "".join(PICTURES)))
    assert named
    assert named <= {path.name for path in (ROOT / "mrbt_mesh").rglob("*.py")}


def test_the_index_of_decisions_calls_them_by_their_numbers() -> None:
    index = (ROOT / "docs" / "decisions" / "README.md").read_text(encoding="utf-8")
    entries = re.findall(r"\[(\d+)\]\((\d+)-", index)
    assert entries
    assert [number for number, _ in entries] == [number for _, number in entries]


def test_decisions_bear_the_numbers_of_their_files() -> None:
    for page in (ROOT / "docs" / "decisions").glob("[0-9]*.md"):
        title = page.read_text(encoding="utf-8").partition("\n")[0]
        assert title.startswith(f"# {page.name[:4]}. ")
