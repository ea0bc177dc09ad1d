"""From BehaviorTree.CPP to a team's tree and back, and what is refused with which reason."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given

from mrbt_mesh.analysis import team_tree
from mrbt_mesh.analysis.team_tree import ALWAYS, TeamTree, to_team_tree
from mrbt_mesh.analysis.team_tree_writer import team_tree_document
from mrbt_mesh.btcpp.files.builtin_nodes import BUILTIN
from mrbt_mesh.btcpp.files.check import check_library
from mrbt_mesh.btcpp.files.document import Category, parse_document
from mrbt_mesh.btcpp.files.expand import expand
from mrbt_mesh.btcpp.files.findings import Findings
from mrbt_mesh.btcpp.files.library import Library, library_of
from mrbt_mesh.core.bt.tree import Kind, Memory, NodeSpec
from mrbt_mesh.errors import FileError
from tests.support.build import sequence
from tests.support.strategies import tree_specs

MOVE = '<Action ID="Move"><input_port name="goal"/><input_port name="speed" default="1"/></Action>'
PICK = '<Action ID="Pick"><output_port name="object"/></Action>'
SEE = '<Condition ID="Sees"><input_port name="what"/></Condition>'


def library(body: str, trees: str = "") -> Library:
    """A library with a tree `Main` of `body`, which stands in line 2."""
    text = (
        '<root BTCPP_format="4" main_tree_to_execute="Main">\n'
        f'<BehaviorTree ID="Main">{body}</BehaviorTree>\n'
        f"{trees}<TreeNodesModel>{MOVE}{PICK}{SEE}</TreeNodesModel></root>"
    )
    findings = Findings()
    result = library_of(parse_document(text, "m.xml"), findings)
    check_library(result, findings)
    assert not findings.errors
    return result


def team(body: str, trees: str = "", leaves: Category | None = None) -> TeamTree:
    return to_team_tree(library(body, trees), "Main", leaves)


def spec(body: str, trees: str = "", leaves: Category | None = None) -> NodeSpec:
    result = team(body, trees, leaves)
    assert result.spec is not None, result.refusals
    return result.spec


def action(subject: str, name: str = "") -> NodeSpec:
    return NodeSpec(Kind.ACTION, name=name, subject=subject)


def condition(subject: str) -> NodeSpec:
    return NodeSpec(Kind.CONDITION, subject=subject)


def test_reactive_controls_are_the_teams() -> None:
    body = '<ReactiveSequence name="s"><Sees what="cup"/><Move goal="dock"/></ReactiveSequence>'
    both = (condition("Sees(cup)"), action("Move(dock,1)"))
    assert spec(body) == NodeSpec(Kind.SEQUENCE, both, "s")
    body = body.replace("ReactiveSequence", "ReactiveFallback")
    assert spec(body) == NodeSpec(Kind.FALLBACK, both, "s")


@pytest.mark.parametrize(
    ("open_tag", "expected"),
    [
        ("<Inverter>", NodeSpec(Kind.INVERTER)),
        ("<ForceSuccess>", NodeSpec(Kind.FORCE_SUCCESS)),
        ("<ForceFailure>", NodeSpec(Kind.FORCE_FAILURE)),
        ('<RetryUntilSuccessful num_attempts="3">', NodeSpec(Kind.RETRY, limit=3)),
        ('<Repeat num_cycles="-1">', NodeSpec(Kind.REPEAT, limit=-1)),
        ("<KeepRunningUntilFailure>", NodeSpec(Kind.KEEP_RUNNING_UNTIL_FAILURE)),
        ('<Timeout msec="1500">', NodeSpec(Kind.TIMEOUT, timeout_us=1_500_000)),
        ("<Parallel>", NodeSpec(Kind.PARALLEL, limit=1, memory=Memory.WHILE_RUNNING)),
        ('<Parallel _reactive="true">', NodeSpec(Kind.PARALLEL, limit=1)),
        ("<Sequence>", NodeSpec(Kind.SEQUENCE, memory=Memory.WHILE_RUNNING)),
        ("<AsyncSequence>", NodeSpec(Kind.SEQUENCE, memory=Memory.WHILE_RUNNING)),
        ("<Fallback>", NodeSpec(Kind.FALLBACK, memory=Memory.WHILE_RUNNING)),
        ("<AsyncFallback>", NodeSpec(Kind.FALLBACK, memory=Memory.WHILE_RUNNING)),
        ("<SequenceWithMemory>", NodeSpec(Kind.SEQUENCE, memory=Memory.UNTIL_SUCCESS)),
    ],
)
def test_decorators(open_tag: str, expected: NodeSpec) -> None:
    tag = open_tag[1:-1].split()[0]
    found = spec(f'{open_tag}<Move goal="a" speed="2"/></{tag}>')
    children = (action("Move(a,2)"),)
    assert found == replace(expected, children=children)


@pytest.mark.parametrize(
    ("ports", "needed", "failures"),
    [
        ("", 3, 0),
        ('success_count="2" failure_count="2"', 2, 0),
        ('success_count="1" failure_count="-1"', 1, 0),
        ('success_count="-2" failure_count="3"', 2, 0),
        ('success_count="1"', 1, 1),
        ('success_count="1" failure_count="2"', 1, 2),
    ],
)
def test_thresholds_of_a_parallel(ports: str, needed: int, failures: int) -> None:
    actions = "".join(f'<Move goal="{goal}"/>' for goal in "abc")
    found = spec(f"<Parallel {ports}>{actions}</Parallel>")
    assert (found.limit, found.failures) == (needed, failures)


def test_script_conditions_become_conditions() -> None:
    body = '<ScriptCondition code="a &amp;&amp; !b || (c == true) &amp;&amp; d != 1"/>'
    a, b, c, d = (condition(name) for name in "abcd")
    not_b = NodeSpec(Kind.INVERTER, (b,))
    a_and_not_b = NodeSpec(Kind.SEQUENCE, (a, not_b))
    c_and_not_d = NodeSpec(Kind.SEQUENCE, (c, NodeSpec(Kind.INVERTER, (d,))))
    assert spec(body) == NodeSpec(Kind.FALLBACK, (a_and_not_b, c_and_not_d))


def test_while_do_else_asks_at_every_tick_and_if_then_else_once() -> None:
    branches = (condition("Sees(x)"), action("Move(a,1)"), action("Move(b,1)"))
    body = '<WhileDoElse><Sees what="x"/><Move goal="a"/><Move goal="b"/></WhileDoElse>'
    assert spec(body) == NodeSpec(Kind.IF_THEN_ELSE, branches)
    remembers = NodeSpec(Kind.IF_THEN_ELSE, branches, memory=Memory.WHILE_RUNNING)
    assert spec(body.replace("WhileDoElse", "IfThenElse")) == remembers


def test_leaves_that_always_end_the_same_way() -> None:
    assert spec("<AlwaysSuccess/>") == condition(ALWAYS)
    assert spec("<AlwaysFailure/>") == NodeSpec(Kind.INVERTER, (condition(ALWAYS),))


RETRIED = '<RetryUntilSuccessful num_attempts="3">{}</RetryUntilSuccessful>'
KEEPER = '<SequenceWithMemory><Move goal="a"/></SequenceWithMemory>'


@pytest.mark.parametrize(
    ("body", "is_kept"),
    [
        (RETRIED.format(KEEPER), True),
        (f"<Sequence>{RETRIED.format(KEEPER)}</Sequence>", True),
        (RETRIED.format(f"<Sequence>{KEEPER}</Sequence>"), False),
        (RETRIED.format(RETRIED.format(KEEPER)), False),
        (f"<Parallel>{RETRIED.format(KEEPER)}</Parallel>", False),
        (f"<ReactiveSequence>{RETRIED.format(KEEPER)}</ReactiveSequence>", False),
        (f'<Repeat num_cycles="2">{KEEPER}</Repeat>', False),
        (f'<Timeout msec="9">{KEEPER}</Timeout>', False),
    ],
)
def test_where_a_team_keeps_its_place(body: str, is_kept: bool) -> None:
    """Elsewhere BehaviorTree.CPP's goes on where it was halted, which no fact tells."""
    result = team(body)
    assert (result.spec is not None) is is_kept
    if not is_kept:
        assert "keeps its place when it is halted" in result.refusals[0].message


def test_what_a_team_does_otherwise_is_noted() -> None:
    result = team(f'<ReactiveSequence>{GO}<Move goal="b"/></ReactiveSequence>')
    (note,) = result.notes
    assert (note.line, note.path) == (2, "Main/ReactiveSequence")
    assert "a team does it once" in note.message
    assert not team(f'<ReactiveSequence><Sees what="x"/>{GO}</ReactiveSequence>').notes


def test_subtrees_pass_constants_on() -> None:
    trees = (
        '<BehaviorTree ID="Go"><SubTree ID="Inner" to="{goal}" _autoremap="true"/></BehaviorTree>'
        '<BehaviorTree ID="Inner"><Move goal="{to}" speed="{v}"/></BehaviorTree>'
    )
    found = spec('<SubTree ID="Go" name="first" goal="dock" v="0.5"/>', trees)
    inner = NodeSpec(Kind.SUBTREE, (action("Move(dock,0.5)"),), "Inner")
    assert found == NodeSpec(Kind.SUBTREE, (inner,), "first")


def test_leaves_without_a_model() -> None:
    assert "action or a condition" in team("<Wave/>").refusals[0].message
    assert spec("<Wave/>", leaves=Category.ACTION) == action("Wave")
    assert spec("<Wave/>", leaves=Category.CONDITION) == condition("Wave")
    assert spec('<Condition ID="Wave" hand="left"/>') == condition("Wave(left)")


GO = '<Move goal="a"/>'


@pytest.mark.parametrize(
    ("body", "path", "reason"),
    [
        ('<Script code="a := 1"/>', "Main/Script", "a script with side effects"),
        ('<ScriptCondition code="(a := 1) == 1"/>', "Main/ScriptCondition", "side effects"),
        ('<ScriptCondition code="a &gt; 3"/>', "Main/ScriptCondition", "are true or false"),
        (f"<MyDecorator>{GO}</MyDecorator>", "Main/MyDecorator", "an unknown Decorator"),
        (f"<Mine>{GO}{GO}</Mine>", "Main/Mine", "an unknown Control"),
        ('<Move goal="{g}"/>', "Main/Move", "port 'goal' uses the blackboard entry 'g'"),
        ('<Pick object="{o}"/>', "Main/Pick", "port 'object' writes the blackboard"),
        ('<Move goal="a b"/>', "Main/Move", "port 'goal' is 'a b'; an argument has"),
        ('<Action ID="go-on"/>', "Main/go-on", "a task's name is made of letters"),
        ('<SubTree ID="Nowhere"/>', "Main/Nowhere", "there is no tree 'Nowhere'"),
        (f'<Repeat num_cycles="{{n}}">{GO}</Repeat>', "Main/Repeat", "blackboard entry 'n'"),
        (f'<Repeat num_cycles="0">{GO}</Repeat>', "", "a count of 1 or more"),
        (f'<Parallel success_count="0">{GO}</Parallel>', "Main/Parallel", "needs 0 successes"),
        (f'<Parallel failure_count="0">{GO}</Parallel>', "Main/Parallel", "allows 0 failures"),
        (f'<Inverter _skipIf="a">{GO}</Inverter>', "Main/Inverter", "_skipIf is not asked"),
        ('<Move goal="a" _onSuccess="a = 1"/>', "Main/Move", "_onSuccess changes the blackboard"),
        ('<SetBlackboard value="1" output_key="a"/>', "Main/SetBlackboard", "it writes"),
        (
            f'<LoopInt queue="1" value="{{v}}">{GO}</LoopInt>',
            "Main/LoopInt",
            "takes items from a queue",
        ),
    ],
)
def test_refusals_name_node_line_and_reason(body: str, path: str, reason: str) -> None:
    result = team(body)
    assert result.spec is None
    (problem,) = result.refusals
    assert (problem.file, problem.line, problem.path) == ("m.xml", 2, path)
    assert reason in problem.message


def test_a_constant_that_might_be_overwritten_is_refused() -> None:
    trees = '<BehaviorTree ID="Go">{}</BehaviorTree>'
    sub = '<SubTree ID="Go" goal="dock"/>'
    assert spec(sub, trees.format('<Move goal="{goal}"/>')).children == (action("Move(dock,1)"),)
    writers = ('<Pick object="{goal}"/>', '<Script code="goal = 1"/>', '<Unknown x="{goal}"/>')
    for writer in writers:
        both = f'<ReactiveSequence>{writer}<Move goal="{{goal}}"/></ReactiveSequence>'
        messages = [p.message for p in team(sub, trees.format(both)).refusals]
        assert any("'Go_1__goal'" in m for m in messages), (writer, messages)


def test_all_refusals_are_listed_in_order() -> None:
    body = (
        '<ReactiveSequence>\n<Script code="a := 1"/>\n<Sleep msec="3"/>\n'
        '<Inverter _post="b = 1">\n<Nothing/></Inverter></ReactiveSequence>'
    )
    assert [problem.line for problem in team(body).refusals] == [3, 4, 5, 6]


def test_every_builtin_node_is_mapped_or_refused_with_a_reason() -> None:
    handled = {"ScriptCondition", "Script", "AlwaysSuccess", "AlwaysFailure"}
    assert set(BUILTIN) <= {*team_tree.KINDS, *team_tree._REASONS, *handled}


def unnamed_subtrees(node: NodeSpec) -> NodeSpec:
    """Subtrees without a name get one from their ID."""
    children = tuple(unnamed_subtrees(child) for child in node.children)
    name = "" if node.kind is Kind.SUBTREE else node.name
    return replace(node, children=children, name=name)


def without_keepers(node: NodeSpec) -> NodeSpec:
    """A Sequence that keeps its place may not stand everywhere."""
    children = tuple(without_keepers(child) for child in node.children)
    keeps = node.memory is Memory.UNTIL_SUCCESS
    memory = Memory.WHILE_RUNNING if keeps else node.memory
    return replace(node, children=children, memory=memory)


@given(tree_specs().map(without_keepers))
def test_a_teams_tree_survives_the_way_to_xml_and_back(tree: NodeSpec) -> None:
    document = team_tree_document(tree, "t.xml")
    text = document.text()
    assert parse_document(text, "t.xml") == document
    findings = Findings(is_strict=True)
    back = library_of(parse_document(text, "t.xml"), findings)
    check_library(back, findings)
    assert not findings.in_order()
    result = to_team_tree(back, "MainTree")
    assert result.refusals == ()
    assert result.spec is not None
    assert unnamed_subtrees(result.spec) == unnamed_subtrees(tree)


def test_expansion_renames_inner_entries_in_scripts_and_ports() -> None:
    trees = (
        '<BehaviorTree ID="Go"><ReactiveSequence><Script code="x := y + @z"/>'
        '<Move goal="{x}" speed="{own}"/></ReactiveSequence></BehaviorTree>'
    )
    body = (
        '<ReactiveSequence><SubTree ID="Go" x="{a}"/><SubTree ID="Go" y="{=}"/></ReactiveSequence>'
    )
    nodes = list(expand(library(body, trees), "Main").root.walk())
    assert [node.ports["code"] for node in nodes if node.type == "Script"] == [
        "a := Go_1__y + z",
        "Go_2__x := y + z",
    ]
    assert [list(node.ports.values()) for node in nodes if node.type == "Move"] == [
        ["{a}", "{Go_1__own}"],
        ["{Go_2__x}", "{Go_2__own}"],
    ]


def test_expansion_is_limited() -> None:
    trees = "".join(
        f'<BehaviorTree ID="T{n}"><ReactiveSequence><SubTree ID="T{n + 1}"/>'
        f'<SubTree ID="T{n + 1}"/></ReactiveSequence></BehaviorTree>'
        for n in range(20)
    )
    with pytest.raises(FileError, match="more than 20000 nodes"):
        expand(library('<SubTree ID="T0"/>', trees), "Main")
    chain = "".join(
        f'<BehaviorTree ID="T{n}"><SubTree ID="T{n + 1}"/></BehaviorTree>' for n in range(300)
    )
    with pytest.raises(FileError, match="258 levels"):
        expand(library('<SubTree ID="T0"/>', chain), "Main")


def test_trees_that_contain_themselves_do_not_expand() -> None:
    text = '<root BTCPP_format="4"><BehaviorTree ID="A"><SubTree ID="A"/></BehaviorTree></root>'
    found = library_of(parse_document(text, "m.xml"), Findings())
    with pytest.raises(FileError, match="A -> A"):
        expand(found, "A")


def test_values_of_a_blackboard_are_scripts_and_pointers() -> None:
    leaves = (condition("found == red"), condition("battery@A1 >= 2.5"), action("get($found)"))
    tree = sequence(*leaves)
    text = team_tree_document(tree, "m.yaml").text()
    assert "found == 'red'" in text
    assert "battery_A1 &gt;= 2.5" in text
    assert 'arg_1="{found}"' in text
