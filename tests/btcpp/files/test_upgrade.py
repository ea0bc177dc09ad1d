"""The version of a file that does not say it, by what it uses."""

from __future__ import annotations

import pytest

from mrbt_mesh.btcpp.files.check import check_library
from mrbt_mesh.btcpp.files.document import parse_document
from mrbt_mesh.btcpp.files.findings import Findings
from mrbt_mesh.btcpp.files.library import library_of
from mrbt_mesh.btcpp.files.upgrade import upgrade
from mrbt_mesh.errors import FileError

VERSION_3 = [
    "<SequenceStar><Go/></SequenceStar>",
    '<Control ID="FallbackStar"><Go/></Control>',
    '<Sequence><SubTreePlus ID="A" x="{y}"/></Sequence>',
    '<SubTree ID="A" __shared_blackboard="true"/>',
    '<Parallel success_threshold="1"><Go/></Parallel>',
    "<RetryUntilSuccesful num_attempts='2'><Go/></RetryUntilSuccesful>",
    '<Find pose="${goal}"/>',
    '<Sequence><Find pose="{goal}"/><SubTree ID="A" to="goal"/></Sequence>',
    '<Sequence><SetBlackboard output_key="g" value="1"/><SubTree ID="A" to="g"/></Sequence>',
]
VERSION_4 = [
    "<Go/>",
    '<Sequence><Find pose="{goal}"/><SubTree ID="A" to="{goal}"/></Sequence>',
    '<Sequence><Find pose="{goal}"/><SubTree ID="A" to="kitchen"/></Sequence>',
    '<Sequence><Script code="a := 1"/><Find pose="{g}"/><SubTree ID="A" to="g"/></Sequence>',
    '<SubTree ID="A" _autoremap="true"/>',
    '<Go _skipIf="a"/>',
    '<Parallel success_count="1"><Go/></Parallel>',
]


@pytest.mark.parametrize(
    ("body", "version"), [*((b, 3) for b in VERSION_3), *((b, 4) for b in VERSION_4)]
)
def test_version(body: str, version: int) -> None:
    text = f'<root>\n<BehaviorTree ID="Main">{body}</BehaviorTree></root>'
    document = parse_document(text, "m.xml")
    findings = Findings()
    upgraded = upgrade(document, findings)
    assert upgraded.root.get("BTCPP_format") == "4"
    assert upgrade(upgraded, findings) is upgraded
    said = f"m.xml:1: root: BTCPP_format is missing; read as version {version}, "
    assert str(findings.in_order()[0]).startswith(said)
    # A file that says its version is of that version, whatever it uses.
    for said_version in (3, 4):
        named = parse_document(text.replace("<root", f"<root BTCPP_format='{said_version}'"), "m")
        assert (upgrade(named, Findings()) is named) is (said_version == 4)


def test_a_bare_name_at_an_output_port_is_an_entry() -> None:
    text = (
        '<root BTCPP_format="3"><BehaviorTree ID="M"><Sequence><Look at="cup" found="where"/>'
        '<Look at="cup" found="{where}"/><Other found="it"/></Sequence></BehaviorTree>'
        '<TreeNodesModel><Action ID="Look"><input_port name="at"/><output_port name="found"/>'
        "</Action></TreeNodesModel></root>"
    )
    findings = Findings()
    (tree,) = upgrade(parse_document(text, "m.xml"), findings).trees
    nodes = [element.attributes for element in tree.walk() if element.attributes.get("found")]
    assert nodes[0] == nodes[1] == {"at": "cup", "found": "{where}"}
    assert nodes[2] == {"found": "it"}, "nobody says that it is an output"
    (told,) = findings.warnings
    assert "found='where' names the entry that is written: '{where}' now" in str(told)


def test_only_what_version_4_refuses_breaks_a_rule() -> None:
    text = (
        '<root BTCPP_format="3"><BehaviorTree ID="M"><SequenceStar>'
        '<SubTree ID="A" to="goal" __autoremap="1"/></SequenceStar></BehaviorTree></root>'
    )
    findings = Findings(is_strict=True)
    upgrade(parse_document(text, "m.xml"), findings)
    assert [finding.problem.path for finding in findings.errors] == ["SequenceStar"]
    assert len(findings.warnings) == 2


@pytest.mark.parametrize(
    ("given", "written", "warning"),
    [
        ('<Go to="${x}"/>', '<Go to="{x}"/>', "to='${x}' is '{x}' now"),
        ('<Go to="{x}" at="$x" name="${n}"/>', '<Go to="{x}" at="$x" name="${n}"/>', ""),
        ('<SubTree ID="A" p="${x}"/>', '<SubTree ID="A" p="{x}"/>', "is '{x}' now"),
        ('<SubTree ID="A" p="{x}"/>', '<SubTree ID="A" p="{x}"/>', ""),
        ('<SubTree ID="A" p="x"/>', '<SubTree ID="A" p="{x}"/>', "names a blackboard entry"),
        ('<SubTreePlus ID="A" p="x" q="${x}"/>', '<SubTree ID="A" p="x" q="{x}"/>', "is '{x}' now"),
        ('<SubTree ID="A" __autoremap="1"/>', '<SubTree ID="A"/>', "no effect on <SubTree>"),
        (
            '<SubTreePlus ID="A" __shared_blackboard="1"/>',
            '<SubTree ID="A"/>',
            "no effect on <SubTreePlus>",
        ),
        (
            '<SubTree ID="A" p="x" __shared_blackboard="true"/>',
            '<SubTree ID="A" _autoremap="true"/>',
            "p='x' has no effect beside __shared_blackboard",
        ),
        (
            '<SubTree ID="A" p="x" __shared_blackboard="false"/>',
            '<SubTree ID="A" p="{x}" _autoremap="false"/>',
            "names a blackboard entry",
        ),
        ('<Action ID="A" p="x"/>', '<SubTree ID="A" p="{x}"/>', "'A' is a tree: a <SubTree>"),
        ('<Action ID="Look" at="x"/>', '<Action ID="Look" at="x"/>', ""),
        ("<FallbackStar><Go/></FallbackStar>", "<Fallback><Go/></Fallback>", "is <Fallback> now"),
        (
            "<SequenceStar><Go/></SequenceStar>",
            "<SequenceWithMemory><Go/></SequenceWithMemory>",
            "keeps its place when it is halted, too",
        ),
        ("<Root><Go/></Root>", "<Go/>", "<Root> of Groot 1 is left out"),
        ("<Root><Go/><Go/></Root>", "<Root><Go/><Go/></Root>", ""),
        (
            "<BlackboardCheckInt><Go/></BlackboardCheckInt>",
            "<BlackboardCheckInt><Go/></BlackboardCheckInt>",
            "write <Precondition",
        ),
    ],
)
def test_what_version_3_meant(given: str, written: str, warning: str) -> None:
    """Line by line as xml_parsing.cpp and tree_node.cpp of 3.8.8 read it."""
    text = (
        '<root BTCPP_format="{}"><BehaviorTree ID="M">{}</BehaviorTree>'
        '<BehaviorTree ID="A"><Go/></BehaviorTree>'
        '<TreeNodesModel><Action ID="Look"/></TreeNodesModel></root>'
    )
    findings = Findings()
    found = upgrade(parse_document(text.format(3, given), "m.xml"), findings)
    assert found == parse_document(text.format(4, written), "m.xml")
    told = " ".join(map(str, findings.in_order()))
    assert warning in told if warning else not told


def test_the_first_of_two_trees_counts_in_version_3() -> None:
    text = (
        '<root BTCPP_format="3"><BehaviorTree ID="A"><Go/></BehaviorTree>'
        '<BehaviorTree ID="A"><Stay/></BehaviorTree></root>'
    )
    findings = Findings()
    (tree,) = upgrade(parse_document(text, "m.xml"), findings).trees
    assert tree.children[0].tag == "Go"
    assert "there is a tree 'A' already, which counts" in str(findings.warnings[0])


@pytest.mark.parametrize(
    ("tag", "remedy"),
    [("Root", "write it in small letters"), ("py_trees.composites.Parallel", "of py_trees")],
)
def test_another_first_element(tag: str, remedy: str) -> None:
    with pytest.raises(FileError, match=f"must be <root>, this is <{tag}>.*{remedy}"):
        parse_document(f"<{tag}/>", "m.xml")


def test_a_dollar_before_an_entry_is_told_in_version_4() -> None:
    text = '<root BTCPP_format="4"><BehaviorTree ID="M"><Go to="${x}"/></BehaviorTree></root>'
    findings = Findings()
    check_library(library_of(parse_document(text, "m.xml"), findings), findings)
    assert "port 'to': '${x}' is a text; for the entry write '{x}'" in str(findings.warnings[0])
