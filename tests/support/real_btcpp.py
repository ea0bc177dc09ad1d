"""BehaviorTree.CPP itself (PyPI's behaviortreepy), in a process of its own: it may crash.

Its Python wrapper registers actions, conditions and decorators without ports, and no controls.
So files are staged for it: ports that models describe are left out, and unknown controls are
Sequences.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from mrbt_mesh.btcpp.files.builtin_nodes import BUILTIN, category_of
from mrbt_mesh.btcpp.files.document import (
    EXPLICIT_TAGS,
    SUBTREE,
    Category,
    Document,
    ports,
    read_document,
    type_id,
)
from mrbt_mesh.btcpp.files.findings import Findings
from mrbt_mesh.btcpp.files.library import Library, load_library
from mrbt_mesh.btcpp.files.upgrade import RENAMED_NODES
from mrbt_mesh.errors import FileError

INSTALL = "BehaviorTree.CPP is not installed: make test-interop"
_SERVER = """
import json, os, sys
import behaviortreepy as btcpp
answers = os.fdopen(os.dup(1), "w")
quiet = os.open(os.devnull, os.O_WRONLY)
os.dup2(quiet, 1)
os.dup2(quiet, 2)
for line in sys.stdin:
    asked = json.loads(line)
    # Files included by a text are looked for here.
    os.chdir(os.path.dirname(asked["file"]))
    factory = btcpp.BehaviorTreeFactory()
    try:
        for name, kind in asked["nodes"].items():
            register = getattr(factory, "register_simple_" + kind.lower())
            if kind == "Decorator":
                register(name, lambda status, _: status)
            else:
                register(name, lambda _: btcpp.NodeStatus.SUCCESS)
        tree = factory.create_tree_from_file(asked["file"])
        if asked["trees"]:
            with open(asked["file"], encoding="utf-8", errors="replace") as file:
                factory.register_behavior_tree_from_text(file.read())
        for name in asked["trees"]:
            factory.create_tree(name)
        if asked["tick"]:
            tree.tick_exactly_once()
        answer = ""
    except Exception as error:
        answer = str(error) or type(error).__name__
    answers.write(json.dumps(answer) + "\\n")
    answers.flush()
"""


class JsonProcess:
    """A program that answers lines of JSON; it is started when it is asked, also after a crash."""

    def __init__(self, program: str) -> None:
        self._program = program
        self._process: subprocess.Popen[str] | None = None

    @property
    def is_running(self) -> bool:
        return self._process is not None

    def ask(self, question: Any) -> Any:
        """The answer; None: it crashed."""
        if self._process is None:
            self._process = subprocess.Popen(
                [sys.executable, "-c", self._program],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
            )
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(json.dumps(question) + "\n")
        self._process.stdin.flush()
        answer = self._process.stdout.readline()
        if answer:
            return json.loads(answer)
        self.close()
        return None

    def close(self) -> None:
        """End the process, if it runs."""
        if self._process is not None:
            self._process.kill()
            self._process.communicate()
        self._process = None


@contextmanager
def real_btcpp(program: str) -> Iterator[JsonProcess]:
    """A program with the library; skips the test where it is not installed."""
    pytest.importorskip("behaviortreepy", reason=INSTALL)
    with closing(JsonProcess(program)) as process:
        yield process


class RealLibrary:
    """Loads files; a crash is a refusal as well."""

    def __init__(self, process: JsonProcess) -> None:
        self._process = process

    def refusal(self, staged: Staged, is_ticked: bool = False) -> str:
        """Why it does not load a file and make its trees, or tick the main one; else ""."""
        asked: dict[str, Any] = {"file": str(staged.file), "nodes": staged.nodes}
        answer = self._process.ask(asked | {"trees": staged.trees, "tick": is_ticked})
        return "it crashed" if answer is None else str(answer)


@dataclass(frozen=True)
class Staged:
    """A file as the wrapper can load it, the nodes to register, and the trees to make."""

    file: Path
    nodes: dict[str, str]
    trees: list[str]


@contextmanager
def real_library() -> Iterator[RealLibrary]:
    """The library; skips the test where it is not installed."""
    with real_btcpp(_SERVER) as process:
        yield RealLibrary(process)


def staged(path: Path, folder: Path, library: Library | None = None) -> Staged:
    """Copy a file and what it includes into `folder`, as far as they can be read.

    `library`: what is known of nodes, if not from the file itself.
    """
    target = folder / path.name
    target.write_bytes(path.read_bytes())
    try:
        read = load_library(path, Findings())
    except FileError:
        return Staged(target, {}, [])
    nodes: dict[str, str] = {}
    for document in read.documents:
        raw = read_document(Path(document.file))
        to = folder / Path(document.file).relative_to(path.parent)
        to.parent.mkdir(parents=True, exist_ok=True)
        if _stage(raw, library or read, nodes):
            to.write_text(raw.text(), encoding="utf-8")
        else:
            to.write_bytes(Path(document.file).read_bytes())
    trees = [tree.get("ID") for document in read.documents for tree in document.trees]
    return Staged(target, nodes, [name for name in trees if name and name.isascii()])


def _stage(document: Document, library: Library, nodes: dict[str, str]) -> bool:
    """Make a document fit for the wrapper; whether anything was changed."""
    is_changed = False
    for tree in document.trees:
        for element in tree.walk():
            name = type_id(element)
            if element is tree or element.tag == SUBTREE or name in {"", *BUILTIN, *RENAMED_NODES}:
                continue
            model = library.models.get(name)
            if model is None and element.tag not in EXPLICIT_TAGS:
                continue
            category = category_of(name, element.tag, library.models, len(element.children))
            for port in ports(element):
                if model is None or port in model.ports:
                    del element.attributes[port]
                    is_changed = True
            if category is not Category.CONTROL:
                nodes[name] = str(category)
            elif element.tag in EXPLICIT_TAGS:
                element.attributes["ID"], is_changed = "Sequence", True
            else:
                element.tag, is_changed = "Sequence", True
    return is_changed
