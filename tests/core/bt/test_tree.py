"""Trees: what may be built, how nodes are numbered, and how errors name the place."""

import pytest
from hypothesis import given

from mrbt_mesh.core.bt.tree import (
    MAX_DEPTH,
    MAX_NODES,
    Kind,
    Memory,
    NodeSpec,
    TreeError,
    build_tree,
)
from tests.support.build import (
    action,
    condition,
    fallback,
    inverter,
    keep_running,
    parallel,
    repeat,
    retry,
    sequence,
    timeout,
)
from tests.support.strategies import tree_specs

A = action("a")


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        (sequence(), "Sequence: Sequence needs at least one child"),
        (fallback(A, sequence()), "Fallback/Sequence: Sequence needs at least one child"),
        (sequence(parallel(0, A)), "Sequence/Parallel: Parallel with M=0 needs 1 <= M <= 1"),
        (parallel(3, A, A), "Parallel: Parallel with M=3 needs 1 <= M <= 2 children"),
        (NodeSpec(Kind.INVERTER), "Inverter: Inverter takes exactly one child, it has 0"),
        (NodeSpec(Kind.TIMEOUT, (A, A), timeout_us=1), "Timeout takes exactly one child, it has 2"),
        (sequence(NodeSpec(Kind.ACTION)), "Sequence/Action: Action names nothing to do"),
        (sequence(NodeSpec(Kind.CONDITION)), "Sequence/Condition: Condition names nothing"),
        (sequence(NodeSpec(Kind.ACTION, (A,), subject="go")), "Sequence/go: Action takes no child"),
        (retry(0, A), "RetryUntilSuccessful takes a count of 1 or more, or -1 for no limit"),
        (repeat(-2, A), "Repeat takes a count of 1 or more, or -1 for no limit"),
        (timeout(0, A), "Timeout: Timeout needs a time above 0"),
        (sequence(fallback(sequence(name="deep"), name="mid")), "Sequence/mid/deep: Sequence"),
        (NodeSpec(Kind.IF_THEN_ELSE, (A,)), "takes 2 or 3 children, it has 1"),
        (NodeSpec(Kind.INVERTER, (A,), memory=Memory.WHILE_RUNNING), "no children to remember"),
        (
            NodeSpec(Kind.FALLBACK, (A,), memory=Memory.UNTIL_SUCCESS),
            "only a Sequence can",
        ),
        (NodeSpec(Kind.PARALLEL, (A, A), limit=1, failures=3), "cannot fail at 3 failures"),
        (NodeSpec(Kind.SEQUENCE, (A,), failures=1), "cannot fail at 1 failures"),
    ],
)
def test_a_broken_rule_is_named_with_the_nodes_path(spec: NodeSpec, message: str) -> None:
    with pytest.raises(TreeError) as caught:
        build_tree(spec)
    assert message in str(caught.value)


def chain(depth: int) -> NodeSpec:
    spec = A
    for _ in range(depth - 1):
        spec = inverter(spec)
    return spec


def test_a_tree_may_be_as_deep_as_the_limit_and_no_deeper() -> None:
    assert len(build_tree(chain(MAX_DEPTH)).nodes) == MAX_DEPTH
    with pytest.raises(TreeError, match=f"deeper than {MAX_DEPTH} levels"):
        build_tree(chain(MAX_DEPTH + 1))


def test_a_tree_may_have_as_many_nodes_as_the_limit_and_no_more() -> None:
    assert len(build_tree(sequence(*[A] * (MAX_NODES - 1))).nodes) == MAX_NODES
    with pytest.raises(TreeError, match=f"more than {MAX_NODES} nodes"):
        build_tree(sequence(*[A] * MAX_NODES))


def test_nodes_are_numbered_in_depth_first_preorder() -> None:
    tree = build_tree(sequence(fallback(action("a"), action("b")), parallel(1, action("c"))))
    assert [node.subject or str(node.kind) for node in tree.nodes] == [
        "Sequence",
        "Fallback",
        "a",
        "b",
        "Parallel",
        "c",
    ]
    assert [node.parent for node in tree.nodes] == [-1, 0, 1, 1, 0, 4]
    assert [node.children for node in tree.nodes] == [(1, 4), (2, 3), (), (), (5,), ()]


@given(tree_specs())
def test_the_nested_form_of_a_tree_builds_the_same_tree_again(spec: NodeSpec) -> None:
    tree = build_tree(spec)
    assert tree.spec() == spec
    assert build_tree(tree.spec()) == tree


@given(tree_specs())
def test_every_subtree_holds_consecutive_indices_behind_its_root(spec: NodeSpec) -> None:
    tree = build_tree(spec)
    for node in tree.nodes:
        assert node == tree.nodes[node.index]
        expected = node.index + 1
        for child in node.children:
            assert (child, tree.nodes[child].parent) == (expected, node.index)
            expected = child + len(build_tree(tree.spec(child)).nodes)


def test_paths_tell_siblings_of_the_same_kind_apart() -> None:
    tree = build_tree(sequence(parallel(1, A), parallel(1, action("fix(2)")), name="all"))
    assert [tree.path(index) for index in (0, 1, 3, 4)] == [
        "all",
        "all/Parallel[1]",
        "all/Parallel[2]",
        "all/Parallel[2]/fix(2)",
    ]


@pytest.mark.parametrize(
    ("spec", "label"),
    [
        (action("fix(2)"), "fix(2)"),
        (condition("open"), "open"),
        (parallel(1, A, A), "Parallel 1/2"),
        (retry(3, A), "RetryUntilSuccessful 3"),
        (repeat(-1, A), "Repeat without limit"),
        (timeout(2.5, A), "Timeout 2.5 s"),
        (keep_running(A), "KeepRunningUntilFailure"),
        (sequence(A, name="close up"), "close up (Sequence)"),
        (NodeSpec(Kind.SUBTREE, (A,), "mend(2)"), "mend(2)"),
    ],
)
def test_labels_are_short_texts_for_people(spec: NodeSpec, label: str) -> None:
    assert build_tree(spec).nodes[0].label == label


def test_actions_come_in_tree_order() -> None:
    tree = build_tree(sequence(action("b"), condition("c"), fallback(action("a"), action("b"))))
    assert [node.subject for node in tree.actions()] == ["b", "a", "b"]


@given(tree_specs())
def test_a_tree_contains_the_kinds_of_its_nodes(spec: NodeSpec) -> None:
    tree = build_tree(spec)
    assert {kind for kind in Kind if spec.contains(kind)} == {node.kind for node in tree.nodes}
    for kind in Kind:
        below = [tree.spec(node.index).contains(kind) for node in tree.nodes]
        assert tree.containing(kind) == below
