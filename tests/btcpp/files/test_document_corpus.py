"""Every file of the corpus: it is read, is valid, and survives being written and read again."""

from __future__ import annotations

from pathlib import Path

import pytest

from mrbt_mesh.btcpp.files.builtin_nodes import BUILTIN
from mrbt_mesh.btcpp.files.check import check_file
from mrbt_mesh.btcpp.files.document import (
    CONDITIONS,
    Category,
    parse_document,
    read_document,
    type_id,
)
from mrbt_mesh.btcpp.files.expand import expand
from mrbt_mesh.btcpp.files.export import explicit, with_ids
from mrbt_mesh.btcpp.files.findings import Findings
from mrbt_mesh.btcpp.files.library import Library, library_of
from mrbt_mesh.btcpp.files.loadable import compact
from mrbt_mesh.btcpp.files.upgrade import upgrade
from mrbt_mesh.views.trees.drawing import render_mermaid
from mrbt_mesh.views.trees.shapes import file_shapes

CORPUS = Path(__file__).parent / "corpus"
FILES = sorted(CORPUS.glob("**/*.xml"))
PACKAGES = [CORPUS / "packages"]

every_file = pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)


def loaded(path: Path) -> Library:
    library, findings = check_file(path, package_folders=PACKAGES)
    assert not findings.errors, "\n".join(map(str, findings.errors))
    return library


def test_the_corpus_covers_the_reference() -> None:
    assert len(FILES) >= 60
    elements = [e for path in FILES for e in read_document(path).root.walk()]
    used = {type_id(element) for element in elements}
    assert set(BUILTIN) <= used
    assert {"SequenceStar", "SubTreePlus", "include", "TreeNodesModel"} <= used
    attributes = {name for element in elements for name in element.attributes}
    assert set(CONDITIONS) <= attributes
    assert {"_autoremap", "__shared_blackboard", "ros_pkg", "_collapsed"} <= attributes


@every_file
def test_round_trip(path: Path) -> None:
    document = read_document(path)
    text = document.text()
    again = parse_document(text, document.file)
    assert again == document
    assert not again.tolerated
    assert again.text() == text
    assert parse_document(text.encode(), document.file) == document


@every_file
def test_valid_and_strict_where_it_claims_to_be(path: Path) -> None:
    loaded(path)
    _, findings = check_file(path, is_strict=True, package_folders=PACKAGES)
    # Files that show what is tolerated break a rule on purpose.
    tolerated = {
        "custom_nodes_without_model": "neither built in nor in <TreeNodesModel>",
        "nav2_controls": "neither built in nor in <TreeNodesModel>",
        "subtree_unresolved": "there is no tree 'ElsewhereInThePackage'",
        "first": "",
        "decorator_loop_json": "takes no JSON here",
        "empty_library": "there is no <BehaviorTree>",
        "attribute_order_and_quotes": "in double quotes",
        "scripts_all_operators": "in double quotes",
        "control_reactive_sequence": "below ReactiveSequence",
        "encoding_utf16": "reads UTF-8 only",
        "processing_instruction": "only as the first of a file",
        "v3_renamed_nodes": "version 3:",
        "v3_subtrees": "version 3:",
    }
    if path.stem in tolerated:
        assert all(tolerated[path.stem] in str(error) for error in findings.errors)
        return
    assert not findings.errors, "\n".join(map(str, findings.errors))


@every_file
def test_export_loses_nothing_that_matters(path: Path) -> None:
    library = loaded(path)
    exported = explicit(library)
    tags = {e.tag for tree in exported.trees for child in tree.children for e in child.walk()}
    assert tags <= {"Action", "Condition", "Control", "Decorator", "SubTree"}
    nodes = [e for tree in exported.trees for child in tree.children for e in child.walk()]
    places = {(e.line, e.column, e.tag) for e in library.documents[0].root.walk()}
    changed = [e for e in nodes if (e.line, e.column, e.tag) not in places]
    assert all(next(iter(e.attributes)) == "ID" for e in changed)
    again = parse_document(exported.text(), str(path))
    assert again == exported
    assert upgrade(again, Findings()) is again
    twice = Library(documents=[again], models=again.models() | library.models)
    assert explicit(twice) == again
    # The compact form and back is the explicit form again; attributes' order may differ.
    short = compact(again)
    back = Library(documents=[short], models=short.models() | library.models)
    for first, second in zip(explicit(back).root.walk(), again.root.walk(), strict=True):
        assert (first.tag, first.attributes) == (second.tag, second.attributes)


@every_file
def test_every_tree_expands_and_can_be_drawn(path: Path) -> None:
    library = loaded(path)
    for name in library.trees:
        count = len(list(expand(library, name).root.walk()))
        assert count >= len(list(library.trees[name].element.walk())) - 1
    shapes = file_shapes(library)
    nodes = sum(len(list(shape.walk())) for shape in shapes)
    assert render_mermaid(shapes).count(":::") == nodes


@every_file
def test_numbered_for_monitors(path: Path) -> None:
    library = loaded(path)
    if library.main_tree is None:
        return
    document = with_ids(library)
    numbered = {int(e.get("_uid")): e for e in document.root.walk() if "_uid" in e.attributes}
    expanded = list(expand(library, library.main_tree).root.walk())
    assert sorted(numbered) == list(range(1, len(expanded) + 1))
    # Depth first, the nodes of a SubTree right after it.
    for uid, node in enumerate(expanded, 1):
        expected = "SubTree" if node.category is Category.SUBTREE else node.type
        assert numbered[uid].tag == node.category
        assert expected in ("SubTree", type_id(numbered[uid]))
    paths = [tree.get("_fullpath") for tree in document.trees]
    assert paths[0] == ""
    assert len(set(paths)) == len(paths)


def test_version_3_models_keep_their_attributes() -> None:
    library = loaded(CORPUS / "v3_groot1_project.xml")
    models = library.documents[0].model_lists[0]
    assert [model.attributes for model in models.children if model.tag == "SubTree"] == [
        {"ID": "Unused", "editable": "true"}
    ]


def test_ports_of_a_guessed_model_may_be_written_if_any_use_gives_an_entry() -> None:
    text = (
        '<root BTCPP_format="4"><BehaviorTree ID="Main"><Sequence>'
        '<Act x="{a}" y="1"/><Act x="2" y="3"/></Sequence></BehaviorTree></root>'
    )
    exported = explicit(library_of(parse_document(text, "m.xml"), Findings()))
    (model,) = exported.model_lists[0].children
    assert [(port.tag, port.get("name")) for port in model.children] == [
        ("inout_port", "x"),
        ("input_port", "y"),
    ]
