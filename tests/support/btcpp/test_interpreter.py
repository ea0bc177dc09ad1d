"""The reference interpreter against what BehaviorTree.CPP's documentation says of each node."""

from __future__ import annotations

from typing import Any

import pytest

from tests.support.btcpp.interpreter import (
    FAILURE,
    IDLE,
    RUNNING,
    SKIPPED,
    SUCCESS,
    Blackboard,
    Node,
    Status,
    TickError,
    World,
    halt,
    leaf,
    tick,
    tick_once,
)


def run(root: Node, count: int, world: World | None = None) -> list[Status]:
    """The statuses of `count` ticks."""
    world = world or World()
    return [tick(root, world) for _ in range(count)]


def ticks(root: Node) -> list[int]:
    """How often each child of `root` was ticked."""
    return [child.ticks for child in root.children]


def test_sequence_goes_on_where_it_stopped_and_starts_over_after_a_failure() -> None:
    root = Node("Sequence", [leaf("SUCCESS"), leaf("RUNNING FAILURE SUCCESS"), leaf("SUCCESS")])
    assert run(root, 2) == [RUNNING, FAILURE]
    assert ticks(root) == [1, 2, 0]
    assert run(root, 1) == [SUCCESS]
    assert ticks(root) == [2, 3, 1]


def test_sequence_with_memory_keeps_its_index_over_failure_and_halt() -> None:
    root = Node("SequenceWithMemory", [leaf("SUCCESS"), leaf("FAILURE RUNNING SUCCESS")])
    world = World()
    assert run(root, 2, world) == [FAILURE, RUNNING]
    halt(root, world)
    assert root.children[1].halts == 1
    assert run(root, 1, world) == [SUCCESS]
    assert ticks(root) == [1, 3]
    assert run(root, 1, world) == [SUCCESS]
    assert ticks(root) == [2, 4]


def test_a_halted_sequence_starts_over() -> None:
    root = Node("Sequence", [leaf("SUCCESS"), leaf("RUNNING SUCCESS")])
    world = World()
    run(root, 1, world)
    halt(root, world)
    assert run(root, 1, world) == [SUCCESS]
    assert ticks(root) == [2, 2]


def test_fallback_is_the_dual() -> None:
    root = Node("Fallback", [leaf("FAILURE"), leaf("RUNNING SUCCESS FAILURE"), leaf("FAILURE")])
    assert run(root, 3) == [RUNNING, SUCCESS, FAILURE]
    assert ticks(root) == [2, 3, 1]


def test_reactive_sequence_restarts_and_halts_siblings() -> None:
    root = Node("ReactiveSequence", [leaf("SUCCESS SUCCESS FAILURE"), leaf("RUNNING")])
    assert run(root, 3) == [RUNNING, RUNNING, FAILURE]
    assert ticks(root) == [3, 2]
    assert root.children[1].halts == 1


def test_reactive_sequence_halts_a_later_child_when_an_earlier_one_runs() -> None:
    root = Node("ReactiveSequence", [leaf("SUCCESS RUNNING"), leaf("RUNNING")])
    assert run(root, 2) == [RUNNING, RUNNING]
    assert root.children[1].halts == 1
    assert root.children[1].status is IDLE


def test_reactive_fallback_is_the_dual() -> None:
    root = Node("ReactiveFallback", [leaf("FAILURE FAILURE SUCCESS"), leaf("RUNNING FAILURE")])
    assert run(root, 3) == [RUNNING, FAILURE, SUCCESS]


@pytest.mark.parametrize(
    "kind", ["Sequence", "SequenceWithMemory", "Fallback", "ReactiveSequence", "ReactiveFallback"]
)
def test_all_skipped_is_skipped(kind: str) -> None:
    root = Node(kind, [leaf("SUCCESS", _skipIf=lambda _: True) for _ in range(2)])
    assert run(root, 2) == [SKIPPED, SKIPPED]
    assert root.status is IDLE
    assert ticks(root) == [0, 0]


def test_one_child_not_skipped_decides() -> None:
    root = Node("Sequence", [leaf("SUCCESS", _skipIf=lambda _: True), leaf("SUCCESS")])
    assert run(root, 1) == [SUCCESS]


def test_async_sequence_yields_after_each_child() -> None:
    root = Node("AsyncSequence", [leaf("SUCCESS"), leaf("SUCCESS"), leaf("SUCCESS")])
    world = World()
    assert run(root, 3, world) == [RUNNING, RUNNING, SUCCESS]
    assert tick_once(root, world) is SUCCESS


def test_async_fallback_yields_after_each_child() -> None:
    assert run(Node("AsyncFallback", [leaf("FAILURE"), leaf("FAILURE")]), 2) == [RUNNING, FAILURE]


def parallel(children: list[Node], **ports: Any) -> Node:
    return Node("Parallel", children, ports=ports)


def test_parallel_checks_its_thresholds_after_each_child() -> None:
    root = parallel([leaf("SUCCESS"), leaf("RUNNING")], success_count=1)
    assert run(root, 1) == [SUCCESS]
    assert ticks(root) == [1, 0]


def test_parallel_ticks_only_children_not_yet_complete() -> None:
    root = parallel([leaf("SUCCESS"), leaf("RUNNING SUCCESS")])
    assert run(root, 2) == [RUNNING, SUCCESS]
    assert ticks(root) == [1, 2]


def test_parallel_fails_once_success_is_out_of_reach() -> None:
    root = parallel([leaf("FAILURE"), leaf("RUNNING")], success_count=2, failure_count=2)
    assert run(root, 1) == [FAILURE]


def test_parallel_negative_thresholds_count_from_the_number_of_children() -> None:
    children = [leaf("FAILURE"), leaf("FAILURE"), leaf("SUCCESS")]
    assert run(parallel(children, success_count=-3, failure_count=-1), 1) == [SUCCESS]
    assert run(parallel([leaf("FAILURE"), leaf("SUCCESS")], success_count=-1), 1) == [FAILURE]


def skipped_leaf() -> Node:
    return leaf("SUCCESS", _skipIf=lambda _: True)


def test_parallel_counts_skips_only_with_a_negative_threshold() -> None:
    assert run(parallel([skipped_leaf(), leaf("SUCCESS")]), 1) == [SUCCESS]
    assert run(parallel([skipped_leaf(), leaf("SUCCESS")], success_count=2), 1) == [RUNNING]
    assert run(parallel([skipped_leaf(), skipped_leaf()], success_count=2), 1) == [SKIPPED]
    assert run(parallel([skipped_leaf(), skipped_leaf()]), 1) == [SUCCESS]


@pytest.mark.parametrize("ports", [{"success_count": 3}, {"failure_count": 3}])
def test_parallel_threshold_above_the_number_of_children(ports: dict[str, int]) -> None:
    with pytest.raises(TickError, match="above the number of children 2"):
        run(parallel([leaf("SUCCESS"), leaf("SUCCESS")], **ports), 1)


def test_parallel_all_waits_and_fails_at_max_failures() -> None:
    children = [leaf("FAILURE"), leaf("RUNNING SUCCESS")]
    root = Node("ParallelAll", children)
    assert run(root, 2) == [RUNNING, FAILURE]
    assert ticks(root) == [1, 2]
    root = Node("ParallelAll", [leaf("FAILURE"), leaf("SUCCESS")], ports={"max_failures": 2})
    assert run(root, 1) == [SUCCESS]
    assert run(Node("ParallelAll", [skipped_leaf()]), 1) == [SKIPPED]


def test_if_then_else_asks_once_while_do_else_at_every_tick() -> None:
    def children() -> list[Node]:
        return [leaf("SUCCESS FAILURE"), leaf("RUNNING"), leaf("RUNNING SUCCESS")]

    once, always = Node("IfThenElse", children()), Node("WhileDoElse", children())
    assert run(once, 3) == [RUNNING] * 3
    assert ticks(once) == [1, 3, 0]
    assert run(always, 3) == [RUNNING, RUNNING, SUCCESS]
    assert ticks(always) == [3, 1, 2]
    assert always.children[1].halts == 1


@pytest.mark.parametrize("kind", ["IfThenElse", "WhileDoElse"])
def test_without_else_branch_failure(kind: str) -> None:
    assert run(Node(kind, [leaf("FAILURE"), leaf("SUCCESS")]), 1) == [FAILURE]
    with pytest.raises(TickError, match="children"):
        run(Node(kind, [leaf("FAILURE")]), 1)


def test_switch_takes_the_matching_case_or_the_last_child() -> None:
    world = World(Blackboard(mode="2.0"))
    ports = {"variable": "{mode}", "case_1": "1", "case_2": "2"}
    children = [leaf("RUNNING"), leaf("RUNNING"), leaf("SUCCESS")]
    root = Node("Switch2", children, ports=ports)
    assert run(root, 1, world) == [RUNNING]
    assert ticks(root) == [0, 1, 0]
    world.blackboard["mode"] = "other"
    assert run(root, 1, world) == [SUCCESS]
    assert root.children[1].halts == 1


def test_try_catch_fails_after_its_catch_child() -> None:
    root = Node("TryCatch", [leaf("SUCCESS"), leaf("FAILURE"), leaf("RUNNING SUCCESS")])
    assert run(root, 2) == [RUNNING, FAILURE]
    assert ticks(root) == [1, 1, 2]
    assert run(Node("TryCatch", [leaf("SUCCESS"), leaf("SUCCESS")]), 1) == [SUCCESS]
    assert run(Node("TryCatch", [skipped_leaf(), leaf("SUCCESS")]), 1) == [SKIPPED]


@pytest.mark.parametrize(("wanted", "count"), [(False, 0), ("true", 1)])
def test_try_catch_on_halt(wanted: Any, count: int) -> None:
    root = Node("TryCatch", [leaf("RUNNING"), leaf("RUNNING")], ports={"catch_on_halt": wanted})
    world = World()
    run(root, 1, world)
    halt(root, world)
    assert ticks(root) == [1, count]
    assert [child.halts for child in root.children] == [1, count]


def test_preconditions_in_order_and_only_when_idle() -> None:
    board = Blackboard(fail=0, win=0, skip=0, go=1)
    world = World(board)
    root = leaf(
        "RUNNING",
        _skipIf=lambda b: b["skip"],
        _successIf=lambda b: b["win"],
        _failureIf=lambda b: b["fail"],
        _while=lambda b: b["go"],
    )
    board.update(fail=1, win=1, skip=1)
    assert run(root, 1, world) == [FAILURE]
    board.update(fail=0)
    assert run(root, 1, world) == [SUCCESS]
    board.update(win=0)
    assert run(root, 1, world) == [SKIPPED]
    board.update(skip=0)
    assert run(root, 1, world) == [RUNNING]
    board.update(fail=1, win=1, skip=1)
    assert run(root, 1, world) == [RUNNING]
    board.update(go=0)
    assert run(root, 1, world) == [SKIPPED]
    assert (root.ticks, root.halts, root.status) == (2, 1, IDLE)


def test_postconditions_and_halting() -> None:
    seen: list[str] = []
    names = ("_onSuccess", "_onFailure", "_onHalted", "_post")
    root = leaf("SUCCESS FAILURE RUNNING", **{n: lambda _, n=n: seen.append(n) for n in names})
    world = World()
    run(root, 3, world)
    halt(root, world)
    assert seen == ["_onSuccess", "_post", "_onFailure", "_post", "_onHalted"]


def test_simple_decorators() -> None:
    statuses = "SUCCESS FAILURE RUNNING"
    assert run(Node("Inverter", [leaf(statuses)]), 3) == [FAILURE, SUCCESS, RUNNING]
    assert run(Node("ForceSuccess", [leaf(statuses)]), 3) == [SUCCESS, SUCCESS, RUNNING]
    assert run(Node("ForceFailure", [leaf(statuses)]), 3) == [FAILURE, FAILURE, RUNNING]
    keep = Node("KeepRunningUntilFailure", [leaf(statuses)])
    assert run(keep, 2) == [RUNNING, FAILURE]
    for kind in ("Inverter", "ForceSuccess", "ForceFailure"):
        assert run(Node(kind, [skipped_leaf()]), 1) == [SKIPPED]


def test_retry_and_repeat_loop_within_a_tick_unless_they_yield() -> None:
    def retry() -> Node:
        ports = {"num_attempts": "3"}
        return Node("RetryUntilSuccessful", [leaf("FAILURE FAILURE SUCCESS")], ports=ports)

    assert run(retry(), 1) == [SUCCESS]
    assert run(retry(), 3, World(yields=True)) == [RUNNING, RUNNING, SUCCESS]
    assert tick_once(retry(), World(yields=True)) is SUCCESS
    repeat = Node("Repeat", [leaf("SUCCESS RUNNING SUCCESS FAILURE")], ports={"num_cycles": 2})
    assert run(repeat, 3) == [RUNNING, SUCCESS, FAILURE]
    assert run(Node("RetryUntilSuccessful", [leaf("FAILURE")], {"num_attempts": 0}), 1) == [FAILURE]
    with pytest.raises(TickError, match="does not end"):
        run(Node("Repeat", [leaf("SUCCESS")], {"num_cycles": -1}), 1)
    with pytest.raises(TickError, match="without end"):
        tick_once(Node("Repeat", [leaf("SUCCESS")], {"num_cycles": -1}), World(yields=True))


def test_retry_keeps_its_count_over_a_skip_and_loses_it_when_halted() -> None:
    board = Blackboard(skip=0)
    child = leaf("RUNNING FAILURE RUNNING FAILURE", _skipIf=lambda b: b["skip"])
    root = Node("RetryUntilSuccessful", [child], {"num_attempts": 2})
    world = World(board)
    assert run(root, 2, world) == [RUNNING, RUNNING]
    assert root.count == 1
    halt(root, world)
    assert root.count == 0
    board["skip"] = 1
    root.count = 1
    assert run(root, 1, world) == [SKIPPED]
    assert root.count == 1


def test_timeout_halts_its_child() -> None:
    world = World()
    root = Node("Timeout", [leaf("RUNNING")], {"msec": 100})
    assert run(root, 1, world) == [RUNNING]
    world.now_ms = 99
    assert run(root, 1, world) == [RUNNING]
    world.now_ms = 100
    assert run(root, 1, world) == [FAILURE]
    assert root.children[0].halts == 1
    assert run(root, 1, world) == [RUNNING]


def test_delay_and_sleep() -> None:
    for root in (
        Node("Delay", [Node("AlwaysSuccess")], {"delay_msec": 50}),
        Node("Sleep", ports={"msec": 50}),
    ):
        world = World()
        assert run(root, 1, world) == [RUNNING]
        world.now_ms = 50
        assert run(root, 2, world) == [SUCCESS, RUNNING]


def test_run_once() -> None:
    assert run(Node("RunOnce", [leaf("RUNNING FAILURE")]), 3) == [RUNNING, FAILURE, SKIPPED]
    root = Node("RunOnce", [leaf("FAILURE")], {"then_skip": "false"})
    assert run(root, 3) == [FAILURE] * 3
    assert ticks(root) == [1]


def test_precondition_asks_only_while_its_child_does_not_run() -> None:
    world = World(Blackboard(ok=1))
    root = Node(
        "Precondition", [leaf("RUNNING SUCCESS")], {"if": lambda b: b["ok"], "else": "SKIPPED"}
    )
    assert run(root, 1, world) == [RUNNING]
    world.blackboard["ok"] = 0
    assert run(root, 2, world) == [SUCCESS, SKIPPED]


def test_loop_puts_each_item_into_its_value() -> None:
    world = World()
    seen: list[Any] = []
    note = Node("Script", ports={"code": lambda b: seen.append(b["item"])})
    root = Node("LoopString", [note], {"queue": "a;b", "value": "{item}"})
    assert run(root, 3, world) == [RUNNING, RUNNING, SUCCESS]
    assert run(root, 3, world) == [RUNNING, RUNNING, SUCCESS]
    assert seen == ["a", "b", "a", "b"]
    world.blackboard["items"] = [1]
    ports = {"queue": "{items}", "value": "{item}", "if_empty": "FAILURE"}
    assert run(Node("LoopInt", [note], ports), 2, world) == [RUNNING, FAILURE]
    assert world.blackboard["items"] == []


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
    world = World()
    seen: list[Any] = []
    note = Node("Script", ports={"code": lambda b: seen.append(b["v"])})
    root = Node(kind, [note], {"queue": queue, "value": "{v}"})
    assert run(root, len(items) + 1, world) == [RUNNING] * len(items) + [SUCCESS]
    assert seen == items
    assert [type(item) for item in seen] == [type(item) for item in items]


def test_updates() -> None:
    world = World()
    skip = Node("SkipUnlessUpdated", [leaf("SUCCESS")], {"entry": "{x}"})
    wait = Node("WaitValueUpdate", [leaf("SUCCESS")], {"entry": "{x}"})
    was = Node("WasEntryUpdated", ports={"entry": "{x}"})
    assert [tick(node, world) for node in (skip, wait, was)] == [SKIPPED, RUNNING, FAILURE]
    for _ in range(2):
        world.blackboard["x"] = 1
        assert [tick(node, world) for node in (skip, wait, was)] == [SUCCESS, SUCCESS, SUCCESS]
        assert [tick(node, world) for node in (skip, wait, was)] == [SKIPPED, RUNNING, FAILURE]


def test_blackboard_leaves() -> None:
    world = World(Blackboard(source=7))
    assert run(Node("SetBlackboard", ports={"value": "{source}", "output_key": "k"}), 1, world) == [
        SUCCESS
    ]
    assert world.blackboard["k"] == 7
    assert run(Node("UnsetBlackboard", ports={"key": "k"}), 1, world) == [SUCCESS]
    assert "k" not in world.blackboard
    condition = Node("ScriptCondition", ports={"code": lambda b: "k" in b})
    assert run(condition, 1, world) == [FAILURE]
    assert run(Node("SubTree", [Node("AlwaysFailure")]), 1, world) == [FAILURE]


def test_scripts_as_texts() -> None:
    world = World()
    script = Node("Script", ports={"code": "n := 1"})
    condition = Node("ScriptCondition", ports={"code": "n == 3"})
    action = leaf("SUCCESS", _skipIf="n > 2", _onSuccess="n += 1")
    root = Node("Sequence", [script, Node("Repeat", [action], {"num_cycles": 9}), condition])
    assert run(root, 1, world) == [SUCCESS]
    assert world.blackboard == {"n": 3}


def test_unknown_kinds_are_refused() -> None:
    with pytest.raises(TickError, match="unknown node type Switch7"):
        run(Node("Switch7"), 1)
