"""Control nodes: what BehaviorTree.CPP's documentation says of each."""

from __future__ import annotations

import pytest

from mrbt_mesh.btcpp import NodeStatus, TickError
from mrbt_mesh.btcpp.executor.node import FAILURE, RUNNING, SKIPPED, SUCCESS
from mrbt_mesh.errors import FileError
from tests.support.btcpp.ticked import Ticked

SKIP = '<Leaf says="SUCCESS" _skipIf="true"/>'


def leaf(says: str) -> str:
    return f'<Leaf says="{says}"/>'


def control(name: str, *says: str, ports: str = "") -> Ticked:
    return Ticked(f"<{name} {ports}>{''.join(leaf(each) for each in says)}</{name}>")


def test_sequence_goes_on_where_it_stopped_and_starts_over_after_a_failure() -> None:
    tree = control("Sequence", "SUCCESS", "RUNNING FAILURE SUCCESS", "SUCCESS")
    assert tree.run(2) == [RUNNING, FAILURE]
    assert tree.ticks == [1, 2, 0]
    assert tree.run() == [SUCCESS]
    assert tree.ticks == [2, 3, 1]


def test_sequence_with_memory_keeps_its_place_over_failure_and_halt() -> None:
    tree = control("SequenceWithMemory", "SUCCESS", "FAILURE RUNNING SUCCESS")
    assert tree.run(3) == [RUNNING, FAILURE, RUNNING]
    tree.executor.halt()
    assert tree.halts == [0, 1]
    assert tree.run() == [SUCCESS]
    assert tree.ticks == [1, 3]
    assert tree.run(2) == [RUNNING, SUCCESS]
    assert tree.ticks == [2, 4]


def test_a_halted_sequence_starts_over() -> None:
    tree = control("Sequence", "SUCCESS", "RUNNING SUCCESS")
    tree.run()
    tree.executor.halt()
    assert tree.is_idle
    assert tree.run() == [SUCCESS]
    assert tree.ticks == [2, 2]


def test_fallback_is_the_dual() -> None:
    tree = control("Fallback", "FAILURE", "RUNNING SUCCESS FAILURE", "FAILURE")
    assert tree.run(3) == [RUNNING, SUCCESS, FAILURE]
    assert tree.ticks == [2, 3, 1]


def test_reactive_sequence_restarts_and_halts_siblings() -> None:
    tree = control("ReactiveSequence", "SUCCESS SUCCESS FAILURE", "RUNNING")
    assert tree.run(3) == [RUNNING, RUNNING, FAILURE]
    assert (tree.ticks, tree.halts) == ([3, 2], [0, 1])
    tree = control("ReactiveSequence", "SUCCESS RUNNING", "RUNNING")
    assert tree.run(2) == [RUNNING, RUNNING]
    assert tree.halts == [0, 1]
    assert tree.leaves[1].status is NodeStatus.IDLE


def test_reactive_fallback_is_the_dual() -> None:
    tree = control("ReactiveFallback", "FAILURE FAILURE SUCCESS", "RUNNING FAILURE")
    assert tree.run(3) == [RUNNING, FAILURE, SUCCESS]


@pytest.mark.parametrize(
    "kind", ["Sequence", "SequenceWithMemory", "Fallback", "ReactiveSequence", "ReactiveFallback"]
)
def test_all_skipped_is_skipped(kind: str) -> None:
    tree = Ticked(f"<Sequence><{kind}>{SKIP}{SKIP}</{kind}></Sequence>")
    assert tree.run(3) == [SKIPPED] * 3
    assert tree.ticks == [0, 0]
    assert Ticked(f"<{kind}>{SKIP}{leaf('SUCCESS')}</{kind}>").run() == [SUCCESS]


def test_async_forms_yield_after_each_child() -> None:
    tree = control("AsyncSequence", "SUCCESS", "SUCCESS", "SUCCESS")
    assert tree.run(3) == [RUNNING, RUNNING, SUCCESS]
    assert tree.once() is SUCCESS
    assert control("AsyncFallback", "FAILURE", "FAILURE").run(2) == [RUNNING, FAILURE]


def test_parallel_checks_its_thresholds_after_each_child() -> None:
    tree = control("Parallel", "SUCCESS", "RUNNING", ports='success_count="1"')
    assert tree.run() == [SUCCESS]
    assert tree.ticks == [1, 0]


def test_parallel_ticks_only_children_not_yet_complete() -> None:
    tree = control("Parallel", "SUCCESS", "RUNNING SUCCESS")
    assert tree.run(2) == [RUNNING, SUCCESS]
    assert tree.ticks == [1, 2]
    out_of_reach = 'success_count="2" failure_count="2"'
    assert control("Parallel", "FAILURE", "RUNNING", ports=out_of_reach).run() == [FAILURE]


def test_parallel_negative_thresholds_count_from_the_number_of_children() -> None:
    ports = 'success_count="-3" failure_count="-1"'
    assert control("Parallel", "FAILURE", "FAILURE", "SUCCESS", ports=ports).run() == [SUCCESS]
    assert control("Parallel", "FAILURE", "SUCCESS").run() == [FAILURE]


@pytest.mark.parametrize(
    ("count", "children", "expected"),
    [
        (-1, SKIP + leaf("SUCCESS"), SUCCESS),
        (2, SKIP + leaf("SUCCESS"), RUNNING),
        (2, SKIP + SKIP, SKIPPED),
        (-1, SKIP + SKIP, SUCCESS),
    ],
)
def test_parallel_counts_skips_only_with_a_negative_threshold(
    count: int, children: str, expected: NodeStatus
) -> None:
    tree = Ticked(f'<Parallel success_count="{count}">{children}</Parallel>')
    assert tree.run() == [expected]


@pytest.mark.parametrize("port", ["success_count", "failure_count"])
def test_parallel_threshold_above_the_number_of_children(port: str) -> None:
    body = f'<Parallel {port}="{{n}}">{leaf("SUCCESS")}{leaf("SUCCESS")}</Parallel>'
    with pytest.raises(TickError, match=f"tree.xml:1: Main/Parallel: {port}=3 is above"):
        Ticked(body, {"n": 3}).run()


def test_parallel_all_waits_and_fails_at_max_failures() -> None:
    tree = control("ParallelAll", "FAILURE", "RUNNING SUCCESS")
    assert tree.run(2) == [RUNNING, FAILURE]
    assert tree.ticks == [1, 2]
    assert control("ParallelAll", "FAILURE", "SUCCESS", ports='max_failures="2"').run() == [SUCCESS]
    assert Ticked(f"<ParallelAll>{SKIP}</ParallelAll>").run() == [SKIPPED]


def test_if_then_else_asks_once_while_do_else_at_every_tick() -> None:
    says = ("SUCCESS FAILURE", "RUNNING", "RUNNING SUCCESS")
    once, always = control("IfThenElse", *says), control("WhileDoElse", *says)
    assert once.run(3) == [RUNNING] * 3
    assert once.ticks == [1, 3, 0]
    assert always.run(3) == [RUNNING, RUNNING, SUCCESS]
    assert (always.ticks, always.halts) == ([3, 1, 2], [0, 1, 0])


@pytest.mark.parametrize("kind", ["IfThenElse", "WhileDoElse"])
def test_without_an_else_branch(kind: str) -> None:
    assert control(kind, "FAILURE", "SUCCESS").run() == [FAILURE]
    with pytest.raises(FileError, match=r"children"):
        control(kind, "FAILURE")
    with pytest.raises(TickError, match="the condition was skipped"):
        Ticked(f"<{kind}>{SKIP}{leaf('SUCCESS')}</{kind}>").run()


@pytest.mark.parametrize(("exact", "asked"), [(False, 2), (True, 1)])
def test_if_then_else_without_else_asks_again_unless_it_is_exact(exact: bool, asked: int) -> None:
    """As in the library, where an action that has failed and was not reset keeps its answer."""
    board = {"ask": 0}
    condition = '<Leaf says="FAILURE" _successIf="false" _failureIf="(ask += 1) > 0"/>'
    again = f"<IfThenElse>{condition}{leaf('SUCCESS')}</IfThenElse>"
    tree = Ticked(f"<ForceSuccess>{again}</ForceSuccess>".replace("&", "&amp;"), board, exact=exact)
    tree.executor.root.children[0].status = RUNNING  # so that nothing above resets it
    tree.executor.root.children[0].tick()
    tree.executor.root.children[0].tick()
    assert tree.board["ask"] == asked


@pytest.mark.parametrize(
    ("mode", "chosen"), [("2.0", 1), (2, 1), ("two", 1), ("1", 0), ("other", 2), (None, 2)]
)
def test_switch_takes_the_matching_case_or_the_last_child(mode: object, chosen: int) -> None:
    children = leaf("RUNNING") * 3
    body = f'<Switch2 variable="{{mode}}" case_1="1" case_2="2">{children}</Switch2>'
    tree = Ticked(body, {} if mode is None else {"mode": mode}, enums={"two": 2})
    assert tree.run() == [RUNNING]
    assert tree.ticks == [index == chosen for index in range(3)]
    tree.board["mode"] = "1"
    tree.run()
    assert tree.halts == [chosen == index and chosen != 0 for index in range(3)]


@pytest.mark.parametrize(
    ("mode", "case", "is_same"),
    [
        *((mode, "1", True) for mode in ("1", "1.0", "1e0", "1.00000001", "one")),
        *((mode, "1", False) for mode in ("1 ", " 1", "+1", "1x", "0x1", "１", "true", "1e400")),
        *(("1_0", "10", False), ("1000_0", "10000", False), ("nan", "NaN", False)),
        *(("1_0", "1_0", True), ("inf", "Infinity", False), ("1e400", "1e500", False)),
    ],
)
@pytest.mark.parametrize("exact", [True, False])
def test_switch_compares_whole_numbers_and_texts(
    mode: str, case: str, is_same: bool, exact: bool
) -> None:
    """As BehaviorTree.CPP 4.10.0 did in each of these."""
    children = leaf("SUCCESS") * 3
    body = f'<Switch2 variable="{{mode}}" case_1="{case}" case_2="zz">{children}</Switch2>'
    tree = Ticked(body, {"mode": mode}, enums={"one": 1}, exact=exact)
    assert tree.run() == [SUCCESS]
    assert tree.ticks == [is_same, 0, not is_same]


def test_try_catch_fails_after_its_catch_child() -> None:
    tree = control("TryCatch", "SUCCESS", "FAILURE", "RUNNING SUCCESS")
    assert tree.run(2) == [RUNNING, FAILURE]
    assert tree.ticks == [1, 1, 2]
    assert control("TryCatch", "SUCCESS", "SUCCESS").run() == [SUCCESS]
    assert Ticked(f"<TryCatch>{SKIP}{leaf('SUCCESS')}</TryCatch>").run() == [SKIPPED]


@pytest.mark.parametrize(("wanted", "count"), [("false", 0), ("true", 1)])
def test_try_catch_on_halt(wanted: str, count: int) -> None:
    tree = control("TryCatch", "RUNNING", "RUNNING", ports=f'catch_on_halt="{wanted}"')
    tree.run()
    tree.executor.halt()
    assert (tree.ticks, tree.halts) == ([1, count], [1, count])
