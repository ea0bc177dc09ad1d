"""Decorators: what BehaviorTree.CPP's documentation says of each."""

from __future__ import annotations

from collections import deque
from typing import Any

import pytest

from mrbt_mesh.btcpp import TickError
from mrbt_mesh.btcpp.executor.node import FAILURE, RUNNING, SKIPPED, SUCCESS
from mrbt_mesh.errors import FileError
from tests.support.btcpp.ticked import Ticked

ALL = '<Leaf says="SUCCESS FAILURE RUNNING"/>'
SKIP = '<Leaf says="SUCCESS" _skipIf="true"/>'


def test_simple_decorators() -> None:
    assert Ticked(f"<Inverter>{ALL}</Inverter>").run(3) == [FAILURE, SUCCESS, RUNNING]
    assert Ticked(f"<ForceSuccess>{ALL}</ForceSuccess>").run(3) == [SUCCESS, SUCCESS, RUNNING]
    assert Ticked(f"<ForceFailure>{ALL}</ForceFailure>").run(3) == [FAILURE, FAILURE, RUNNING]
    keep = f"<KeepRunningUntilFailure>{ALL}</KeepRunningUntilFailure>"
    assert Ticked(keep).run(2) == [RUNNING, FAILURE]
    for kind in ("Inverter", "ForceSuccess", "ForceFailure"):
        assert Ticked(f"<{kind}>{SKIP}</{kind}>").run() == [SKIPPED]
    assert Ticked(keep.replace(ALL, SKIP)).run() == [RUNNING]


def retry(says: str, attempts: int, **options: Any) -> Ticked:
    leaf = f'<Leaf says="{says}"/>'
    return Ticked(
        f'<RetryUntilSuccessful num_attempts="{attempts}">{leaf}</RetryUntilSuccessful>', **options
    )


def test_retry_and_repeat_yield_between_attempts() -> None:
    assert retry("FAILURE FAILURE SUCCESS", 3).run(3) == [RUNNING, RUNNING, SUCCESS]
    assert retry("FAILURE FAILURE SUCCESS", 3).once() is SUCCESS
    assert retry("FAILURE FAILURE SUCCESS", 3, yields=False).run() == [SUCCESS]
    assert retry("FAILURE", 0).run() == [FAILURE]
    repeat = '<Repeat num_cycles="2"><Leaf says="SUCCESS RUNNING SUCCESS FAILURE"/></Repeat>'
    assert Ticked(repeat).run(4) == [RUNNING, RUNNING, SUCCESS, FAILURE]


@pytest.mark.parametrize("yields", [True, False])
def test_a_loop_without_end_is_noticed(yields: bool) -> None:
    tree = Ticked('<Repeat num_cycles="-1"><AlwaysSuccess/></Repeat>', yields=yields)
    with pytest.raises(TickError, match=r"Repeat/AlwaysSuccess: .* does not end"):
        tree.once()


@pytest.mark.parametrize("yields", [True, False])
def test_a_loop_whose_leaf_is_never_ticked_is_noticed(yields: bool) -> None:
    body = '<RetryUntilSuccessful num_attempts="-1"><Leaf says="SUCCESS" _failureIf="true"/>'
    tree = Ticked(f"{body}</RetryUntilSuccessful>", yields=yields)
    with pytest.raises(TickError, match=r"RetryUntilSuccessful/Leaf: .* does not end"):
        tree.once()


@pytest.mark.parametrize("exact", [False, True])
def test_a_precondition_after_a_halt(exact: bool) -> None:
    """The library goes on with the child and does not ask the script again."""
    gate = '<Precondition if="n == 0" else="FAILURE"><Leaf says="RUNNING"/></Precondition>'
    body = f'<ReactiveSequence><ScriptCondition code="go"/>{gate}</ReactiveSequence>'
    tree = Ticked(body, {"n": 0, "go": True}, exact=exact)
    assert tree.run() == [RUNNING]
    tree.board["go"] = False
    assert tree.run() == [FAILURE]
    tree.board["go"], tree.board["n"] = True, 1
    assert tree.run() == [RUNNING if exact else FAILURE]


@pytest.mark.parametrize("exact", [False, True])
def test_a_guard_yields_only_if_it_is_exact(exact: bool) -> None:
    guard = '<Repeat num_cycles="2"><AlwaysSuccess/></Repeat>'
    body = f'<ReactiveSequence>{guard}<Leaf says="RUNNING"/></ReactiveSequence>'
    tree = Ticked(body, exact=exact)
    for _ in range(3):
        tree.once()
    assert tree.halts == [2 if exact else 0]


def test_retry_keeps_its_count_over_a_skip_and_loses_it_when_halted() -> None:
    leaf = '<Leaf says="RUNNING FAILURE RUNNING FAILURE" _skipIf="skip == 1"/>'
    body = f'<RetryUntilSuccessful num_attempts="2">{leaf}</RetryUntilSuccessful>'
    tree = Ticked(body, {"skip": 0})
    root: Any = tree.executor.root
    assert tree.run(2) == [RUNNING, RUNNING]
    assert root.count == 1
    tree.executor.halt()
    assert root.count == 0
    root.count = 1
    tree.board["skip"] = 1
    assert tree.run() == [SKIPPED]
    assert root.count == 1


@pytest.mark.parametrize("exact", [False, True])
def test_a_precondition_whose_child_is_skipped_stays_idle(exact: bool) -> None:
    child = '<Leaf says="SUCCESS" _skipIf="k"/>'
    gate = f'<Precondition if="true" _failureIf="x == 1" _onHalted="h := 1">{child}</Precondition>'
    body = f'<ReactiveFallback>{gate}<Leaf says="RUNNING"/></ReactiveFallback>'
    tree = Ticked(body, {"k": True, "x": 0}, exact=exact)
    assert tree.run() == [RUNNING]
    # So it is not halted with its parent, and asked again before it starts.
    assert "h" not in tree.board
    tree = Ticked(gate, {"k": True, "x": 0}, exact=exact)
    assert tree.run() == [SKIPPED]
    tree.board["x"] = 1
    assert tree.run() == [FAILURE]


def test_retry_reads_its_number_again_after_each_failure() -> None:
    body = '<Leaf says="FAILURE FAILURE FAILURE FAILURE SUCCESS" _onFailure="n += 1"/>'
    text = f'<RetryUntilSuccessful num_attempts="{{n}}">{body}</RetryUntilSuccessful>'
    for yields in (True, False):
        tree = Ticked(text, {"n": 1}, yields=yields)
        assert tree.once() is SUCCESS
        assert tree.ticks == [5]
    fewer = text.replace("n += 1", "n = 1")
    assert Ticked(fewer, {"n": 5}).run() == [FAILURE]
    # One that has vanished stays as it was until the next tick.
    gone = '<Fallback><Sequence><UnsetBlackboard key="n"/><AlwaysFailure/></Sequence></Fallback>'
    text = f'<RetryUntilSuccessful num_attempts="{{n}}">{gone}</RetryUntilSuccessful>'
    assert Ticked(text, {"n": 2}, yields=False).run() == [FAILURE]


def test_repeat_reads_its_number_once_in_a_tick() -> None:
    body = '<Leaf says="SUCCESS" _onSuccess="n += 1"/>'
    tree = Ticked(f'<Repeat num_cycles="{{n}}">{body}</Repeat>', {"n": 1})
    assert tree.run() == [SUCCESS]
    assert tree.ticks == [1]


@pytest.mark.parametrize("kind", ["Repeat num_cycles", "RetryUntilSuccessful num_attempts"])
def test_a_child_that_is_skipped_is_reset_by_what_repeats_it(kind: str) -> None:
    # A Sequence whose children were all skipped counts as running.
    skipped = f'<Sequence _onHalted="h := 1" _skipIf="x == 1">{SKIP}</Sequence>'
    tree = Ticked(f'<{kind}="2">{skipped}</{kind.split()[0]}>', {"x": 0})
    assert tree.run() == [SKIPPED]
    assert tree.board["h"] == 1


def test_run_once() -> None:
    assert Ticked('<RunOnce><Leaf says="RUNNING FAILURE"/></RunOnce>').run(3) == [
        RUNNING,
        FAILURE,
        SKIPPED,
    ]
    tree = Ticked('<RunOnce then_skip="false"><Leaf says="FAILURE"/></RunOnce>')
    assert tree.run(3) == [FAILURE] * 3
    assert tree.ticks == [1]


def test_precondition_asks_only_while_its_child_does_not_run() -> None:
    leaf = '<Leaf says="RUNNING SUCCESS"/>'
    tree = Ticked(f'<Precondition if="ok == 1" else="SKIPPED">{leaf}</Precondition>', {"ok": 1})
    assert tree.run() == [RUNNING]
    tree.board["ok"] = 0
    assert tree.run(2) == [SUCCESS, SKIPPED]


def test_loop_puts_each_item_into_its_value() -> None:
    note = '<Note what="{item}"/>'
    tree = Ticked(f'<LoopString queue="a;b" value="{{item}}">{note}</LoopString>')
    assert tree.run(6) == [RUNNING, RUNNING, SUCCESS] * 2
    assert tree.seen == ["a", "b", "a", "b"]
    body = f'<LoopInt queue="{{items}}" value="{{item}}" if_empty="FAILURE">{note}</LoopInt>'
    tree = Ticked(body, {"items": [1]})
    assert tree.run(2) == [RUNNING, FAILURE]
    assert tree.board["items"] == [1]
    failing = '<LoopInt queue="1;2;3" value="{item}"><Leaf says="SUCCESS FAILURE"/></LoopInt>'
    assert Ticked(failing).run(2) == [RUNNING, FAILURE]
    with pytest.raises(TickError, match="port 'queue': the entry 'items' has no value"):
        Ticked(body).run()
    with pytest.raises(TickError, match="'items' is not a list"):
        Ticked(body, {"items": 3}).run()


@pytest.mark.parametrize("queue", ["a;b;c", ["a", "b", "c"], ("a", "b", "c")])
@pytest.mark.parametrize("exact", [True, False])
def test_a_loop_begins_a_text_or_a_list_anew(queue: Any, exact: bool) -> None:
    """A route whose second point fails is tried again from its first point."""
    body = (
        '<RetryUntilSuccessful num_attempts="2"><LoopString queue="{q}" value="{v}"><Sequence>'
        '<Note what="{v}"/><Leaf says="SUCCESS FAILURE SUCCESS"/></Sequence></LoopString>'
        "</RetryUntilSuccessful>"
    )
    tree = Ticked(body, {"q": queue}, exact=exact)
    statuses = tree.run(8)
    assert SUCCESS in statuses
    assert tree.seen[:5] == ["a", "b", "a", "b", "c"]
    assert tree.board["q"] == queue


def test_a_loop_uses_up_a_queue_that_others_may_add_to() -> None:
    queue = deque(["a", "b"])
    loop = '<LoopString queue="{q}" value="{v}"><Note what="{v}"/></LoopString>'
    tree = Ticked(f"<Sequence>{loop}{loop}</Sequence>", {"q": queue})
    assert tree.run() == [RUNNING]
    queue.append("c")
    assert tree.run(3) == [RUNNING, RUNNING, SUCCESS]
    assert tree.seen == ["a", "b", "c"]
    assert not queue


@pytest.mark.parametrize(
    ("text", "items"),
    [("", []), ("a;", ["a"]), (";", [""]), ("a;;b", ["a", "", "b"]), (";a", ["", "a"])],
)
def test_a_text_is_split_as_the_library_does(text: str, items: list[str]) -> None:
    """Measured with BehaviorTree.CPP 4.10.0."""
    tree = Ticked(
        '<LoopString queue="{q}" value="{v}"><Note what="{v}"/></LoopString>', {"q": text}
    )
    assert tree.run(len(items) + 1)[-1] is SUCCESS
    assert tree.seen == items


@pytest.mark.parametrize(
    ("kind", "queue", "items"),
    [
        ("LoopInt", "1;-2", [1, -2]),
        ("LoopDouble", "1.5; 2", [1.5, 2.0]),
        ("LoopBool", "true;0", [True, False]),
        ("LoopString", "a; b", ["a", " b"]),
        ("LoopInt", "json:[3, 4]", [3, 4]),
        ("LoopString", "", []),
    ],
)
def test_constant_queues_have_items_of_their_kind(kind: str, queue: str, items: list[Any]) -> None:
    tree = Ticked(f'<{kind} queue="{queue}" value="{{v}}"><Note what="{{v}}"/></{kind}>')
    assert tree.run(len(items) + 1) == [RUNNING] * len(items) + [SUCCESS]
    assert tree.seen == items
    assert [type(item) for item in tree.seen] == [type(item) for item in items]


def test_a_queue_that_cannot_be_read_is_told_with_its_place() -> None:
    with pytest.raises(FileError, match=r"tree.xml:1: Main/LoopInt: .*'queue'.*'b'"):
        Ticked('<LoopInt queue="1;b" value="{v}"><AlwaysSuccess/></LoopInt>')


@pytest.mark.parametrize("value", ["", 'value="5"'])
def test_the_items_of_a_loop_without_an_entry_go_nowhere(value: str) -> None:
    tree = Ticked(f'<LoopInt queue="1;2" {value}><Leaf says="SUCCESS"/></LoopInt>')
    assert tree.run(3) == [RUNNING, RUNNING, SUCCESS]
    assert tree.ticks == [2]


def test_run_once_skips_if_its_port_has_no_value() -> None:
    tree = Ticked('<RunOnce then_skip="{none}"><Leaf says="SUCCESS"/></RunOnce>')
    assert tree.run(2) == [SUCCESS, SKIPPED]


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ('<Script code="3 = 4"/>', "only a blackboard entry can stand before '='"),
        ('<AlwaysSuccess _onSuccess="1 := 2"/>', "only a blackboard entry can stand before ':='"),
        ('<Parallel success_count="2"><AlwaysSuccess/></Parallel>', "success_count"),
        ('<Precondition if="false" else="no"><AlwaysSuccess/></Precondition>', "is not a status"),
        ('<SetBlackboard output_key="n"/>', "port 'value' is missing"),
    ],
)
def test_what_the_library_notices_when_it_ticks_is_noticed_then(body: str, message: str) -> None:
    tree = Ticked(body)
    with pytest.raises(TickError, match=message):
        tree.run()


@pytest.mark.parametrize(
    ("kind", "otherwise"), [("SkipUnlessUpdated", SKIPPED), ("WaitValueUpdate", RUNNING)]
)
def test_updates(kind: str, otherwise: object) -> None:
    tree = Ticked(f'<{kind} entry="{{x}}"><Leaf says="RUNNING SUCCESS"/></{kind}>')
    assert tree.run() == [otherwise]
    tree.board["x"] = 1
    assert tree.run(3) == [RUNNING, SUCCESS, otherwise]
    tree.board["x"] = 1
    assert tree.run(2) == [SUCCESS, otherwise]


@pytest.mark.parametrize("exact", [True, False])
@pytest.mark.parametrize("kind", ["SkipUnlessUpdated", "WaitValueUpdate"])
def test_the_child_of_a_halted_update_is_halted(kind: str, exact: bool) -> None:
    tree = Ticked(f'<{kind} entry="{{x}}"><Leaf says="RUNNING"/></{kind}>', {"x": 1}, exact=exact)
    assert tree.run() == [RUNNING]
    tree.executor.halt()
    assert tree.halts[0] >= 1


def test_a_subtree_has_a_blackboard_of_its_own() -> None:
    inner = '<BehaviorTree ID="In"><Script code="x := 1; given += 1; @top := 2"/></BehaviorTree>'
    tree = Ticked('<SubTree ID="In" given="{outer}"/>', {"outer": 4}, trees=inner)
    assert tree.run() == [SUCCESS]
    assert {name: tree.board[name] for name in tree.board.names()} == {"outer": 5, "top": 2}
