"""The version of a file that does not say it, by what it uses."""

from __future__ import annotations

import pytest

from mrbt_mesh.btcpp.files.document import parse_document
from mrbt_mesh.btcpp.files.findings import Findings
from mrbt_mesh.btcpp.files.upgrade import upgrade

VERSION_3 = [
    "<SequenceStar><Go/></SequenceStar>",
    '<Control ID="FallbackStar"><Go/></Control>',
    '<Sequence><SubTreePlus ID="A" x="{y}"/></Sequence>',
    '<SubTree ID="A" __shared_blackboard="true"/>',
    '<Parallel success_threshold="1"><Go/></Parallel>',
    "<RetryUntilSuccesful num_attempts='2'><Go/></RetryUntilSuccesful>",
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
