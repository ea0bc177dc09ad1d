"""Strict checking against BehaviorTree.CPP itself: what it refuses, and nothing else.

`make test-interop` installs it (4.8.2 at present). Known differences, each of which is looked for:
what it notices only when it ticks the node, and what came with later versions.
"""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.btcpp.files.builtin_nodes import BUILTIN, children_allowed
from mrbt_mesh.btcpp.files.check import check_file
from mrbt_mesh.btcpp.files.document import Category, Document, read_document
from mrbt_mesh.btcpp.files.elements import Content, Element
from mrbt_mesh.errors import FileError, InputError
from mrbt_mesh.views.trees.converting import Wanted, convert_file
from tests.support.paths import EXAMPLES, ROOT, mission_file
from tests.support.real_btcpp import INSTALL, RealLibrary, real_library, staged

pytest.importorskip("behaviortreepy", reason=INSTALL)  # all 900 of them need it

FILES = sorted([*ROOT.joinpath("tests").glob("**/*.xml"), *EXAMPLES.glob("**/*.xml")])
# BehaviorTree.CPP has no node for jobs.
MISSIONS = sorted({*EXAMPLES.glob("*/mission.yaml")} - {mission_file("deliveries")})
# Errors that the library finds when it ticks the node.
LATE = re.compile(
    r"is not a status|needs the port '|(IfThenElse|WhileDoElse|Switch\d) needs|is above the number|"
    r"_on\w+: the script|_post: the script|port 'if': the script|the script ''|is not JSON"
)
# Rules and features of later versions, and our own limit.
LATER = re.compile(
    r"the name '|is a reserved name|nested deeper|more than \d+ attributes|in double quotes"
)
# 4.9 takes a last semicolon; 4.10 chooses the only tree that is a file's own, whatever it includes.
NEW = re.compile(
    r"TryCatch|json:|=\"x \+= 1;\"|<include(?!.*<BehaviorTree.*<BehaviorTree)", re.DOTALL
)


@pytest.fixture(scope="module")
def real() -> Iterator[RealLibrary]:
    with real_library() as library:
        yield library


def strict_errors(path: Path) -> list[str]:
    try:
        _, findings = check_file(path, is_strict=True)
    except FileError as error:
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


# -- random files -----------------------------------------------------------------------------

PORT_VALUES = [
    *("3", "-1", "0", "+2", " 4", "1.5", "4x", "x", "", "{a}", "{b}", " {a} ", "{}", "{=}", "="),
    *("true", "TRUE", "yes", "1", "1;2", "a;b", "SUCCESS", "success", "FAILURE"),
    *("2000000000", "3000000000", "9999999999"),
]
SCRIPTS = ["a := 1", "b == 2 && a < 3", "a :=", "12ab", "true", "a", "", "x += 1;"]
CUSTOM = {"Act": "Action", "Ask": "Condition", "Wrap": "Decorator", "Several": "Control"}
ATTRIBUTES = [
    *("num_attempts", "num_cycles", "msec", "delay_msec", "then_skip", "else", "if", "code"),
    *("queue", "if_empty", "value", "entry", "output_key", "key", "variable", "case_1", "wrong"),
    *("success_count", "failure_count", "max_failures", "name", "_autoremap"),
    *("_skipIf", "_onSuccess", "_while", "_x"),
]
SCRIPTED = ("code", "if", "_skipIf", "_while", "_onSuccess")
INNER = ("Control", "Decorator")
# A tree that contains itself is none of them: until its stack is full, the library takes a minute.
OF_MAIN = ("Second", "Third", "Third", "Nowhere", "Sequence")


@dataclass
class RandomFiles:
    """Files whose nodes are nearly right; at most about `nodes` of them."""

    random: Random
    nodes: int = 12

    def node(self, trees: tuple[str, ...]) -> Element:
        """With the ports that it has, and sometimes another one. `trees`: for SubTrees."""
        self.nodes -= 1
        kinds = {name: str(model.category) for name, model in BUILTIN.items()} | CUSTOM
        may_have_more = self.nodes > 0
        names = [name for name, kind in kinds.items() if may_have_more or kind not in INNER]
        name = self.random.choice([*names, "SubTree", "SubTree"])
        if name == "SubTree":
            element = Element("SubTree", {"ID": self.random.choice(trees)})
            if self.random.random() < 0.5:
                port = self.random.choice(["p", "_autoremap", "name"])
                element.attributes[port] = self.random.choice(["true", "{a}", "5", "{=}"])
            return element
        is_explicit = self.random.random() < 0.25
        element = Element(kinds[name], {"ID": name}) if is_explicit else Element(name)
        for port in BUILTIN[name].ports if name in BUILTIN else ():
            if self.random.random() < 0.9:
                self.give(element, port, BUILTIN[name].ports[port].type)
        if self.random.random() < 0.1:
            self.give(element, self.random.choice(ATTRIBUTES), "")
        fewest, most = children_allowed(name, Category(kinds[name]))
        count = self.random.randint(fewest, min(most or 3, fewest + 1)) if most != 0 else 0
        count += self.random.choice([0] * 20 + [1, -1])
        element.content = [self.node(trees) for _ in range(max(count, 0))]
        return element

    def give(self, element: Element, port: str, kind: str) -> None:
        """A value for a port, of its type more often than not."""
        usual = {"int": "3", "unsigned int": "5", "bool": "true", "BT::NodeStatus": "SUCCESS"}
        if kind in usual and self.random.random() < 0.6:
            element.attributes[port] = usual[kind]
        else:
            values = SCRIPTS if port in SCRIPTED else PORT_VALUES
            element.attributes[port] = self.random.choice(values)

    def file(self) -> Document:
        """Three trees and the models of the nodes that are not built in."""
        models: list[Content] = [Element(kind, {"ID": name}) for name, kind in CUSTOM.items()]
        if self.random.random() < 0.5:
            port = Element("input_port", {"name": "p"})
            models.append(Element("SubTree", {"ID": "Second"}, [port]))
        root = Element("root", {"BTCPP_format": "4", "main_tree_to_execute": "Main"})
        root.content = [
            Element("BehaviorTree", {"ID": "Main"}, [self.node(OF_MAIN)]),
            Element("BehaviorTree", {"ID": "Second"}, [self.node(("Third",))]),
            Element("BehaviorTree", {"ID": "Third"}, [Element("AlwaysSuccess")]),
            Element("TreeNodesModel", {}, models),
        ]
        return Document("random.xml", [root])


def files() -> st.SearchStrategy[Document]:
    """Random files by their seeds: each has so many choices that Hypothesis would be slow."""
    return st.integers(0, 10**9).map(lambda seed: RandomFiles(Random(seed)).file())


@given(files())
def test_random_files(real: RealLibrary, document: Document) -> None:
    with TemporaryDirectory() as folder:
        path = Path(folder) / "random.xml"
        path.write_text(document.text(), encoding="utf-8")
        inner = Path(folder) / "staged"
        inner.mkdir()
        compare(path, real, inner)


# -- what is written --------------------------------------------------------------------------


def converted_loads(path: Path, real: RealLibrary, folder: Path, wanted: Wanted) -> None:
    """What is written loads, unless what is wrong with it cannot be written otherwise."""
    target = folder / "converted.xml"
    try:
        convert_file(path, target, wanted)
    except InputError:
        return
    if not wanted.is_merged and read_document(target).includes:
        shutil.copytree(path.parent, folder, dirs_exist_ok=True)
        convert_file(path, target, wanted)
    errors = [e for e in strict_errors(target) if not LATE.search(e) and not LATER.search(e)]
    assert not [e for e in errors if "ReactiveSequence <" in e or "version 3" in e]
    inner = folder / "staged"
    inner.mkdir()
    refusal = real.refusal(staged(target, inner))
    if errors:
        assert refusal, f"it loads {target.read_text()}\nthough {errors}"
    elif not NEW.search(target.read_text()) and not strict_errors(target):
        assert not refusal, f"{refusal}:\n{target.read_text()}"


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(ROOT)))
@pytest.mark.parametrize("is_compact", [False, True], ids=["explicit", "compact"])
def test_every_file_converted(
    path: Path, is_compact: bool, real: RealLibrary, tmp_path: Path
) -> None:
    converted_loads(path, real, tmp_path, Wanted(is_compact))


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(ROOT)))
def test_every_file_merged(path: Path, real: RealLibrary, tmp_path: Path) -> None:
    converted_loads(path, real, tmp_path, Wanted(is_merged=True))


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(ROOT)))
def test_every_file_as_a_monitor_sees_it(path: Path, real: RealLibrary, tmp_path: Path) -> None:
    converted_loads(path, real, tmp_path, Wanted(has_ids=True))


@pytest.mark.parametrize("path", MISSIONS, ids=lambda path: path.parent.name)
def test_every_example_mission(path: Path, real: RealLibrary, tmp_path: Path) -> None:
    """All of them load, and strict checking finds nothing wrong with them."""
    target = tmp_path / "mission.xml"
    convert_file(path, target, Wanted())
    assert not strict_errors(target)
    inner = tmp_path / "staged"
    inner.mkdir()
    assert not real.refusal(staged(target, inner))


@given(files())
def test_random_files_converted(real: RealLibrary, document: Document) -> None:
    with TemporaryDirectory() as folder:
        path = Path(folder) / "random.xml"
        path.write_text(document.text(), encoding="utf-8")
        converted_loads(path, real, Path(folder), Wanted())
