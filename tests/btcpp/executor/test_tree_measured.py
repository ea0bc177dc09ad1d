"""Trees with blackboards against those of the real BehaviorTree.CPP: tests/data/btcpp/README.md."""

from __future__ import annotations

import gzip
import json
from collections import Counter
from dataclasses import dataclass
from typing import Any

from tests.support.btcpp.random_trees import Ends, Told, ours
from tests.support.paths import ROOT

DATA = ROOT / "tests" / "data" / "btcpp" / "blackboards.jsonl.gz"


@dataclass
class Measured:
    """A tree with its story, and what the library did."""

    xml: str
    sets: list[dict[str, Any]]
    ends: Ends
    told: Told


def test_a_tree_does_what_the_library_did() -> None:
    with gzip.open(DATA, "rt", encoding="utf-8") as lines:
        shared = json.loads(next(lines))
        cases = [Measured(**json.loads(line)) for line in lines]
    ends: Counter[str] = Counter()
    for case in cases:
        found = ours(case, shared["entries"], shared["seen"])
        failed = isinstance(case.told[-1], str)
        # Messages are not compared.
        assert found[: -1 if failed else None] == case.told[: -1 if failed else None], case.xml
        ends[case.told[-2] if failed else case.told[-1][0]] += 1
    assert len(cases) == 500
    assert ends["SUCCESS"] > 100
    assert ends["error"] > 50
