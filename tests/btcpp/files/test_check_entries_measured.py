"""Strict checking against what BehaviorTree.CPP made trees of: tests/data/btcpp/README.md."""

from __future__ import annotations

import gzip
import json
import re
from pathlib import Path

from mrbt_mesh.btcpp.files.check import check_library
from mrbt_mesh.btcpp.files.findings import Findings
from mrbt_mesh.btcpp.files.library import load_text
from tests.support.paths import ROOT

DATA = ROOT / "tests" / "data" / "btcpp" / "creation.jsonl.gz"
# Errors that the library finds when it ticks the node.
LATE = re.compile(
    r"needs the port|is above the number|(IfThenElse|WhileDoElse|Switch\d|TryCatch) needs|"
    r"cannot be run: only|is not a status"
)


def strict_errors(xml: str) -> list[str]:
    findings = Findings(is_strict=True)
    check_library(load_text(xml, Path("tree.xml"), findings), findings)
    return [finding.problem.message for finding in findings.errors]


def test_strict_checking_refuses_what_the_library_does() -> None:
    with gzip.open(DATA, "rt", encoding="utf-8") as lines:
        rows = [json.loads(line) for line in lines]
    for xml, refusal in rows:
        errors = strict_errors(xml)
        if refusal:
            assert errors, (refusal, xml)
        else:
            assert all(map(LATE.search, errors)), (errors, xml)
    assert len(rows) == 553
    assert sum(bool(refusal) for _, refusal in rows) == 165
