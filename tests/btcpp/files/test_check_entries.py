"""Types of entries: what BehaviorTree.CPP refuses when it makes a tree."""

from __future__ import annotations

from pathlib import Path

import pytest

from mrbt_mesh.btcpp.files.check import check_library
from mrbt_mesh.btcpp.files.findings import Findings, Severity
from mrbt_mesh.btcpp.files.library import load_text

MODELS = """
<Action ID="GetInt"><output_port name="out" type="int"/></Action>
<Action ID="UseInt"><input_port name="n" type="int"/></Action>
<Action ID="UseReal"><input_port name="x" type="double"/></Action>
<Action ID="GetText"><output_port name="text" type="std::string"/></Action>
<Action ID="UseText"><input_port name="text" type="std::string"/></Action>
<Action ID="UseAny"><input_port name="any" type="BT::AnyTypeAllowed"/></Action>
<Action ID="GetPath">
  <output_port name="path" type="nav_msgs::msg::Path_&lt;std::allocator&lt;void&gt; &gt;"/>
</Action>
<Action ID="UsePath"><input_port name="path" type="nav_msgs/Path"/></Action>
<Action ID="UsePose"><input_port name="pose" type="geometry_msgs::msg::Pose"/></Action>
<Action ID="UseItems"><input_port name="items" type="std::vector&lt;int&gt;"/></Action>
<Action ID="Preset"><input_port name="n" type="int" default="many"/></Action>
"""


def errors(body: str, inner: str = "<AlwaysSuccess/>", models: str = "") -> list[str]:
    """What strict checking finds in a tree `Main`, with a tree `In` for its SubTrees."""
    text = (
        '<root BTCPP_format="4" main_tree_to_execute="Main">'
        f'<BehaviorTree ID="Main">{body}</BehaviorTree><BehaviorTree ID="In">{inner}'
        f"</BehaviorTree><TreeNodesModel>{MODELS}{models}</TreeNodesModel></root>"
    )
    findings = Findings(is_strict=True)
    check_library(load_text(text, Path("tree.xml"), findings), findings)
    lenient = Findings()
    check_library(load_text(text, Path("tree.xml"), lenient), lenient)
    assert all(found.severity is Severity.WARNING for found in lenient.in_order())
    return [found.problem.message for found in findings.errors]


REFUSED = [
    ('<Sequence><GetInt out="{a}"/><UseReal x="{a}"/></Sequence>', "", "'a' is of type int, by"),
    ('<Sequence><GetInt out="{a}"/><UseText text="{a}"/></Sequence>', "", "of type int, by port"),
    ('<Sequence><GetPath path="{a}"/><UsePose pose="{a}"/></Sequence>', "", "of type nav_msgs::P"),
    (
        '<Sequence><GetInt out="{a}"/><SubTree ID="In" b="{a}"/></Sequence>',
        '<UseReal x="{b}"/>',
        "port 'x' is of type double, but its entry 'b' is of type int, by port 'out' of GetInt",
    ),
    (
        '<Sequence><SubTree ID="In" _autoremap="true"/><UseReal x="{a}"/></Sequence>',
        '<GetInt out="{a}"/>',
        "of type int, by port 'out' of GetInt",
    ),
    ('<SubTree ID="In" b="5"/>', '<UseReal x="{b}"/>', "by the value '5' of a SubTree"),
    ('<Sequence><GetInt out="{a}"/><Sleep msec="{a}"/></Sequence>', "", "of type unsigned int"),
    ('<UseInt n="x"/>', "", "port 'n': 'x' is not a whole number"),
    ('<UseInt n="3000000000"/>', "", "'3000000000' is not of type int"),
    ('<UseReal x="+5"/>', "", "'+5' is not a number"),
    ('<UseItems items="1;b"/>', "", "'b' is not a whole number"),
    ('<UseItems items="json:[&quot;a&quot;]"/>', "", "is not a JSON list of int"),
    ('<Script code="{code}"/>', "", "the entry 'code' has no value then"),
    ('<SubTree ID="In" c="x :="/>', '<Script code="{c}"/>', "the script 'x :=' cannot be read"),
    ('<LoopInt queue="json:[1]" value="{v}"><AlwaysSuccess/></LoopInt>', "", "takes no JSON"),
    ('<LoopInt queue="1" value="x"><AlwaysSuccess/></LoopInt>', "", "'x' is not a whole number"),
]


@pytest.mark.parametrize(("body", "inner", "message"), REFUSED)
def test_what_the_library_refuses(body: str, inner: str, message: str) -> None:
    found = errors(body, inner or "<AlwaysSuccess/>")
    assert len(found) == 1, found
    assert message in found[0]


@pytest.mark.parametrize(
    ("body", "inner"),
    [
        ('<Sequence><GetText text="{a}"/><UseInt n="{a}"/><UseReal x="{a}"/></Sequence>', ""),
        ('<Sequence><UseAny any="{a}"/><UseInt n="{a}"/><UseReal x="{a}"/></Sequence>', ""),
        ('<Sequence><GetPath path="{a}"/><UsePath path="{a}"/></Sequence>', ""),
        ('<Sequence><GetInt out="{a}"/><SubTree ID="In"/></Sequence>', '<UseReal x="{a}"/>'),
        ('<SubTree ID="In" b="5"/>', '<UseInt n="{b}"/>'),
        ('<SubTree ID="In" b="+5"/>', '<UseReal x="{b}"/>'),
        ('<SubTree ID="In" c="x := 1"/>', '<Script code="{c}"/>'),
        ('<UseInt n="5x"/>', ""),
        ("<Preset/>", ""),
        ('<LoopDouble queue="inf;1" value="{v}"><AlwaysSuccess/></LoopDouble>', ""),
        ('<UseItems items="json:[1, 2]"/>', ""),
        ('<LoopString queue="a;b"><AlwaysSuccess/></LoopString>', ""),
        ('<LoopInt queue="1;2" value="5"><AlwaysSuccess/></LoopInt>', ""),
        (
            '<Sequence><UseInt n="{a}"/><LoopInt queue="{a}" value="{v}"><AlwaysSuccess/></LoopInt>'
            "</Sequence>",
            "",
        ),
    ],
)
def test_what_the_library_takes(body: str, inner: str) -> None:
    assert errors(body, inner or "<AlwaysSuccess/>") == []


def test_a_default_in_the_model_of_a_subtree_has_a_type() -> None:
    model = '<SubTree ID="In"><input_port name="b" default="{}"/></SubTree>'
    assert (
        "by the value '1' of a SubTree"
        in errors('<SubTree ID="In"/>', '<UseReal x="{b}"/>', model.format(1))[0]
    )
    assert not errors('<SubTree ID="In"/>', '<UseReal x="{b}"/>', model.format("1.0"))


def test_a_tree_is_checked_where_it_is_used() -> None:
    """Alone the entries `b` and `c` would be two, of two types."""
    inner = '<Sequence><GetInt out="{b}"/><UseReal x="{c}"/></Sequence>'
    assert not errors('<SubTree ID="In" b="{x}" c="{y}"/>', inner)
    assert len(errors('<SubTree ID="In" b="{x}" c="{x}"/>', inner)) == 1
