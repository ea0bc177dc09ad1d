"""Scripts against the verdicts of the real BehaviorTree.CPP 4.10: tests/data/btcpp/README.md."""

from __future__ import annotations

import gzip
import json
import math
from collections import Counter
from typing import Any

from mrbt_mesh.formats.btcpp.document import parse_document
from mrbt_mesh.formats.btcpp.script import ScriptError
from mrbt_mesh.formats.btcpp.script_eval import evaluate
from mrbt_mesh.formats.btcpp.script_parser import parse
from mrbt_mesh.formats.btcpp.xml_reader import TreeFileError
from tests.support.paths import ROOT

DATA = ROOT / "tests" / "data" / "btcpp" / "scripts.jsonl.gz"
ENUMS = {"RED": 1, "BLUE": 2}


def shown(value: Any) -> str:
    """A value as the measuring program printed it."""
    if value is None:
        return "empty"
    if isinstance(value, str):
        return f"'{value}'"
    # C++ prints the sign of what is no number.
    return "nan" if math.isnan(value) else format(value, ".12g" if type(value) is float else "d")


def verdict(text: str) -> str:
    """As measured: read from the attribute of a file, parsed, run."""
    escaped = text.replace("&", "&amp;").replace("<", "&lt;")
    try:
        # The measured scripts stood between double quotes as they are: one inside ends them.
        document = parse_document(f'<root><Script code="{escaped}"/></root>', "script.xml")
    except TreeFileError:
        return "ERRP"
    entries: dict[str, Any] = {"a": 3, "b": 2.5, "s": "txt", "t": True}
    try:
        script = parse(document.root.children[0].get("code"))
    except ScriptError:
        return "ERRP"
    try:
        value = evaluate(script, entries, ENUMS)
    except ScriptError:
        return "ERRE"
    after = [f"{key}={shown(entries[key]) if key in entries else 'none'}" for key in "abstn"]
    return " ".join(["OK", shown(value), *after])


def test_every_script_ends_as_in_the_library() -> None:
    with gzip.open(DATA, "rt", encoding="utf-8") as lines:
        rows = [json.loads(line) for line in lines]
    kinds: Counter[str] = Counter()
    for text, measured in rows:
        kind = measured[:4] if measured.startswith("ERR") else "OK"
        kinds[kind] += 1
        expected = measured.replace("-nan", "nan") if kind == "OK" else kind
        assert verdict(text) == expected, (text, measured)
    assert kinds == {"ERRP": 3050, "ERRE": 2541, "OK": 2409}
