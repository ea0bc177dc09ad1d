"""Nodes that call functions: arguments, outputs, results."""

from __future__ import annotations

import asyncio
from typing import Any

import anyio
import pytest

from mrbt_mesh.btcpp import BehaviorTree, InOut, NodeStatus, Out, TaskFailedError, TickError


def tree_of(body: str, **entries: Any) -> BehaviorTree:
    text = f'<root BTCPP_format="4"><BehaviorTree ID="Main">{body}</BehaviorTree></root>'
    tree = BehaviorTree.from_text(text)
    for name, value in entries.items():
        tree.blackboard[name] = value
    return tree


def test_inputs_are_converted_and_outputs_are_written() -> None:
    tree = tree_of('<Work a="3" b="{b}" out="{o}" both="{n}"/>', b="2.5", n=4)
    seen: list[Any] = []

    @tree.action("Work")
    def work(a: int, b: float, out: Out[str], both: InOut[int], c: str = "usual") -> bool:
        seen.extend([a, b, c, both.value])
        out.set("done")
        both.set(both.value + 1)
        return False

    assert tree.executor.tick(0) is NodeStatus.FAILURE
    assert seen == [3, 2.5, "usual", 4]
    assert (tree.blackboard["o"], tree.blackboard["n"]) == ("done", 5)


def needs(kind: Any) -> Any:
    def work(v: Any) -> None:
        seen.append(v)

    seen: list[Any] = []
    work.__annotations__ = {"v": kind}
    return work, seen


@pytest.mark.parametrize("exact", [True, False])
@pytest.mark.parametrize(
    ("kind", "value", "got"),
    [
        # As the library's getInput: a number is converted if nothing is lost, else an error.
        (int, 2.5, None),
        (int, 1e20, None),
        (int, float("nan"), None),
        (int, 3.0, 3),
        (int, -3.0, -3),
        (int, True, 1),
        (int, 2**31, 2**31),
        (float, 3, 3.0),
        (float, 2**53, None),
        (bool, 1, True),
        (bool, 2, None),
        (bool, 0.5, True),
        (bool, -0.5, None),
        (str, 2.5, "2.500000"),
        (str, 3, "3"),
        (list[float], [1, 2.5], [1.0, 2.5]),
        (list[int], [1.5], None),
        (list[int], ["1", 2.0], [1, 2]),
        (int, {"x": 1}, None),
        (float, [1.0], None),
    ],
)
def test_an_entry_becomes_what_the_parameter_is_or_an_error(
    kind: Any, value: Any, got: Any, exact: bool
) -> None:
    text = f'<root BTCPP_format="4"><BehaviorTree ID="Main">{WORK}</BehaviorTree></root>'
    tree = BehaviorTree.from_text(text, exact=exact)
    work, seen = needs(kind)
    tree.action("Work")(work)
    executor = tree.executor
    tree.blackboard.write("x", value)
    if got is None:
        with pytest.raises(TickError, match="Work: port 'v'"):
            executor.tick(0)
    else:
        assert executor.tick(0) is NodeStatus.SUCCESS
        assert seen == [got]
        assert type(seen[0]) is type(got)


WORK = '<Work v="{x}"/>'


@pytest.mark.parametrize(
    "way",
    [
        f'<Sequence><Script code="x := 5/2"/>{WORK}</Sequence>',
        '<SubTree ID="Inner" x="2.5"/>',
        '<Sequence><Script code="y := 5/2"/><SubTree ID="Inner" x="{y}"/></Sequence>',
    ],
)
def test_a_fraction_is_no_integer_wherever_it_comes_from(way: str) -> None:
    text = (
        f'<root BTCPP_format="4" main_tree_to_execute="Main"><BehaviorTree ID="Main">{way}'
        f'</BehaviorTree><BehaviorTree ID="Inner">{WORK}</BehaviorTree></root>'
    )
    tree = BehaviorTree.from_text(text)
    work, _ = needs(int)
    tree.action("Work")(work)
    with pytest.raises(TickError, match=r"2\.5 is not an integer"):
        tree.executor.tick(0)


def test_a_time_is_not_negative() -> None:
    timed = '<Timeout msec="{n}"><AlwaysSuccess/></Timeout>'
    tree = tree_of(f'<Sequence><Script code="n := -5"/>{timed}</Sequence>')
    with pytest.raises(TickError, match="-5 is out of the range of unsigned int"):
        tree.executor.tick(0)


def test_a_default_is_for_a_port_that_is_left_out() -> None:
    """By default also for an entry that has no value, which the library takes for an error."""
    for exact in (False, True):
        for body, fails in (("<Work/>", False), ('<Work v="{x}"/>', exact)):
            text = f'<root BTCPP_format="4"><BehaviorTree ID="Main">{body}</BehaviorTree></root>'
            tree = BehaviorTree.from_text(text, exact=exact)
            seen: list[int] = []

            @tree.action("Work")
            def work(v: int = 5, seen: Any = seen) -> None:
                seen.append(v)

            if fails:
                with pytest.raises(TickError, match="the entry 'x' has no value"):
                    tree.executor.tick(0)
            else:
                assert tree.executor.tick(0) is NodeStatus.SUCCESS
                assert seen == [5]


@pytest.mark.parametrize("ports", ["", ' error="" retries=""'])
def test_outputs_may_be_left_out_also_by_an_empty_text(ports: str) -> None:
    tree = tree_of(f"<Work{ports}/>")

    @tree.action("Work")
    def work(error: Out[str] | None = None, retries: InOut[int] | None = None) -> bool:
        return error is None and retries is None

    assert tree.executor.tick(0) is NodeStatus.SUCCESS


@pytest.mark.parametrize("answer", [True, False])
def test_a_condition_may_be_async_if_it_does_not_wait(answer: bool) -> None:
    tree = tree_of("<Ok/>")

    @tree.condition("Ok")
    async def ok() -> bool:
        return answer

    assert tree.executor.tick(0) is (NodeStatus.SUCCESS if answer else NodeStatus.FAILURE)


def test_a_condition_that_waits_is_told() -> None:
    tree = tree_of("<Ok/>")

    class Forever:
        def __await__(self) -> Any:
            while True:
                yield

    @tree.condition("Ok")
    async def ok() -> None:
        await Forever()

    with pytest.raises(TickError, match="Main/Ok: the condition 'Ok' waits"):
        tree.executor.tick(0)


async def test_a_condition_may_let_others_run() -> None:
    """As an asynchronous lock does that is free."""
    tree, lock = tree_of("<Ok/>"), anyio.Lock()

    @tree.condition("Ok")
    async def ok() -> bool:
        await asyncio.sleep(0)
        async with lock:
            return True

    assert tree.executor.tick(0) is NodeStatus.SUCCESS
    assert not lock.locked()


def test_wrong_values_are_told_with_node_and_port() -> None:
    tree = tree_of('<Work a="{a}"/>', a="many")
    tree.action("Work")(_work)
    with pytest.raises(TickError, match="Main/Work: port 'a': the text 'many' is not an integer"):
        tree.executor.tick(0)
    tree = tree_of('<Work a="{a}"/>')
    tree.action("Work")(_work)
    with pytest.raises(TickError, match="port 'a': the entry 'a' has no value"):
        tree.executor.tick(0)


def _work(a: int) -> None:
    raise TaskFailedError(f"no {a}")


def test_a_plain_function_fails_with_a_reason() -> None:
    tree = tree_of('<Work a="3"/>')
    tree.action("Work")(_work)
    assert tree.executor.tick(0) is NodeStatus.FAILURE
    assert [view.reason for view in tree.view()] == ["no 3"]


def test_an_output_of_a_wrong_type_is_told() -> None:
    tree = tree_of('<Sequence><Work out="{n}"/><Sleep msec="{n}"/></Sequence>')

    @tree.action("Work")
    def work(out: Out[Any]) -> None:
        out.set("soon")

    with pytest.raises(TickError, match="Work: port 'out': the entry 'n' is of type unsigned int"):
        tree.executor.tick(0)
