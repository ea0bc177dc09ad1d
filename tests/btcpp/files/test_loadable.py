"""What BehaviorTree.CPP refuses is written in another form that means the same."""

from __future__ import annotations

import pytest

from mrbt_mesh.btcpp.files.document import parse_document
from mrbt_mesh.btcpp.files.elements import Comment, Element
from mrbt_mesh.btcpp.files.export import explicit
from mrbt_mesh.btcpp.files.findings import Findings
from mrbt_mesh.btcpp.files.library import library_of
from mrbt_mesh.btcpp.files.loadable import loadable


def written(body: str, attributes: str = 'ID="Main"') -> Element:
    text = f'<root BTCPP_format="4"><BehaviorTree {attributes}>{body}</BehaviorTree></root>'
    library = library_of(parse_document(text, "m.xml"), Findings())
    return loadable(explicit(library)).root


def test_children_of_a_reactive_sequence_are_compact() -> None:
    """Whatever form it and they have; a name that is none for a tag has to stay."""
    body = (
        '<Control ID="ReactiveSequence"><Action ID="Go" goal="1"/><Inverter><Ask/></Inverter>'
        '<SubTree ID="Dock"/><Action ID="a b"/><Action ID="Action"/></Control>'
    )
    (top,) = written(body).children[0].children
    assert (top.tag, top.get("ID")) == ("Control", "ReactiveSequence")
    assert [child.tag for child in top.children] == [
        "Go",
        "Inverter",
        "SubTree",
        "Action",
        "Action",
    ]
    assert top.children[0].attributes == {"goal": "1"}
    assert top.children[1].children[0].tag == "Action"


def test_a_lone_tree_without_an_id_stays_alone() -> None:
    assert [e.tag for e in written("<Go/>", "").children] == ["BehaviorTree"]
    assert [e.tag for e in written("<Go/>").children] == ["BehaviorTree", "TreeNodesModel"]


def test_a_built_in_node_gets_the_tag_of_its_kind() -> None:
    (node,) = written('<Action ID="Inverter"><Go/></Action>').children[0].children
    assert node.tag == "Decorator"


def test_instructions_become_comments() -> None:
    document = parse_document("<?a?><!-- b --><?c d--e?><root><?f?></root>", "m.xml")
    found = loadable(document)
    assert found.items[2] == Comment("?c d- -e?")
    assert found.root.content == [Comment("?f?")]
    assert parse_document(found.text(), "m.xml") == found


@pytest.mark.parametrize(
    ("kind", "given", "expected"),
    [
        ("LoopInt", "json:[1, -2]", "1;-2"),
        ("LoopDouble", "json:[1.5, 2]", "1.5;2"),
        ("LoopBool", "json:[true, false]", "true;false"),
        ("LoopString", 'json:["a", "b c"]', "a;b c"),
        ("LoopString", 'json:["a;b"]', 'json:["a;b"]'),
        ("LoopString", 'json:[" a"]', 'json:[" a"]'),
        ("LoopInt", "json:[true]", "json:[true]"),
        ("LoopInt", "json:[]", "json:[]"),
        ("LoopInt", "json:[1", "json:[1"),
        ("LoopInt", "{q}", "{q}"),
    ],
)
def test_lists(kind: str, given: str, expected: str) -> None:
    quoted = given.replace('"', "&quot;")
    (node,) = written(f'<{kind} queue="{quoted}" value="{{v}}"><Go/></{kind}>').children[0].children
    assert node.get("queue") == expected
