"""Strict checking against BehaviorTree.CPP itself: what it refuses, and nothing else.

`make test-interop` installs it (4.8.2 at present). Known differences, each of which is looked for:
what it notices only when it ticks the node, and what came with later versions.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.cli.trees.converting import Wanted, convert_file
from mrbt_mesh.formats.btcpp.check import check_file
from mrbt_mesh.formats.btcpp.document import Document
from mrbt_mesh.formats.btcpp.elements import Element
from mrbt_mesh.formats.btcpp.findings import Findings
from mrbt_mesh.formats.btcpp.library import load_library
from mrbt_mesh.formats.btcpp.xml_reader import TreeFileError
from tests.support.paths import EXAMPLES, ROOT
from tests.support.real_btcpp import RealLibrary, real_library, staged

FILES = sorted([*ROOT.joinpath("tests").glob("**/*.xml"), *EXAMPLES.glob("**/*.xml")])
# Errors that the library finds when it ticks the node.
LATE = re.compile(
    r"is not a status|needs the port '|(IfThenElse|WhileDoElse|Switch\d) needs|is above the number|"
    r"_on\w+: the script|_post: the script|port '(code|if)': the script|is no JSON"
)
# Rules and features of later versions, and our own limit.
LATER = re.compile(r"the name '|is a reserved name|nested deeper|more than \d+ attributes")
NEW = re.compile(r"TryCatch|json:")


@pytest.fixture(scope="module")
def real() -> Iterator[RealLibrary]:
    with real_library() as library:
        yield library


def strict_errors(path: Path) -> list[str]:
    try:
        _, findings = check_file(path, is_strict=True)
    except TreeFileError as error:
        return [problem.message for problem in error.problems]
    return [finding.problem.message for finding in findings.errors]


def compare(path: Path, real: RealLibrary, folder: Path) -> None:
    """Our verdict is the library's, but for the known differences."""
    errors = strict_errors(path)
    at_once = [e for e in errors if not LATE.search(e) and not LATER.search(e)]
    content = path.read_text(encoding="utf-8", errors="replace")
    file = staged(path, folder)
    refusal = real.refusal(file)
    if at_once:
        assert refusal, f"it loads {content}\nthough {at_once}"
    elif not errors and not NEW.search(content):
        assert not refusal, f"{refusal}:\n{content}"
    elif errors and not refusal and not any(map(LATER.search, errors)):
        assert all(map(LATE.search, errors))


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(ROOT)))
def test_every_file_of_the_repository(path: Path, real: RealLibrary, tmp_path: Path) -> None:
    compare(path, real, tmp_path)


def test_what_it_finds_late_it_does_find(real: RealLibrary, tmp_path: Path) -> None:
    """A file with one late error loads, and throws when it is ticked."""
    folder = Path(__file__).parent / "malformed"
    late = []
    for path in sorted(folder.iterdir()):
        errors = strict_errors(path)
        if errors and all(map(LATE.search, errors)):
            file = staged(path, tmp_path)
            assert not real.refusal(file), path
            if real.refusal(file, is_ticked=True):
                late.append(path.stem)
    assert len(late) >= 5, late
