"""Expressions over messages: a part of Python, with Python's own answers."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.adapters.ros2.expression import MessageExpression, MessageExpressionError

NUMBERS = st.integers(-1000, 1000) | st.floats(-1e3, 1e3)


@st.composite
def expressions(draw: st.DrawFn, depth: int = 3) -> str:
    """Texts that are expressions over m.a, m.b.c and m.items."""
    if depth == 0 or draw(st.booleans()):
        leaf = st.sampled_from(["m.a", "m.b.c", "m.items[0]", "m.items[-1]", "3", "0.5", "True"])
        return draw(leaf)
    inner = expressions(depth - 1)
    left, right = draw(inner), draw(inner)
    form = draw(
        st.sampled_from(
            [
                *("({} + {})", "({} - {})", "({} * {})", "({} / {})", "({} % {})", "({} // {})"),
                *("({} < {})", "({} == {})", "({} and {})", "({} or {})", "max({}, {})"),
                *("(not {} or {})", "(-{} <= {})", "abs({}) >= {}", "({} in [1, 2, {}])"),
            ]
        )
    )
    return form.format(left, right)


@given(expressions(), NUMBERS, NUMBERS, st.lists(NUMBERS, min_size=1, max_size=3))
def test_what_python_says(text: str, a: Any, c: Any, items: list[Any]) -> None:
    m = SimpleNamespace(a=a, b=SimpleNamespace(c=c), items=items)
    known = {"a": a, "b.c": c, "items[0]": items[0], "items[-1]": items[-1]}
    if "m." not in text:
        with pytest.raises(MessageExpressionError, match="reads nothing"):
            MessageExpression(text)
        return
    expression = MessageExpression(text)
    fields = {name: known[name] for name in expression.fields}
    try:
        expected = eval(text, {"m": m})
    except ArithmeticError:
        with pytest.raises(MessageExpressionError):
            expression.value(fields)
        return
    assert expression.value(fields) == expected


@given(st.booleans(), st.booleans(), st.booleans())
def test_truths(a: bool, b: bool, c: bool) -> None:
    found = MessageExpression("m.a and not m.b or m.c").truth({"a": a, "b": b, "c": c})
    assert found is ((a and not b) or c)


@pytest.mark.parametrize(
    ("text", "fields"),
    [
        ("m.percentage < 0.2", ("percentage",)),
        ("m.poses[0].x + m.poses[0].x > m.y", ("poses[0].x", "y")),
        ("len(m.ranges) > 3 and min(m.ranges) < 0.5", ("ranges",)),
        ("yaw(m.pose.q)", ("pose.q.x", "pose.q.y", "pose.q.z", "pose.q.w")),
        ("m.state in ['open', 'ajar']", ("state",)),
    ],
)
def test_only_the_fields_that_are_read_are_asked_for(text: str, fields: tuple[str, ...]) -> None:
    assert MessageExpression(text).fields == fields


@given(st.floats(-3.1, 3.1))
def test_yaw_of_a_quaternion(heading: float) -> None:
    fields = {"q.x": 0.0, "q.y": 0.0, "q.z": math.sin(heading / 2), "q.w": math.cos(heading / 2)}
    assert MessageExpression("yaw(m.q)").number(fields) == pytest.approx(heading)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("m.a <", "is not an expression: invalid syntax"),
        ("3 < 4", "reads nothing of the message, e.g. m.data"),
        ("percentage < 0.2", "fields of the message are m.NAME, e.g. m.percentage"),
        ("open(m.a)", "the functions are abs, all, any"),
        ("m.a.__class__()", "the functions are abs"),
        ("m.a ** 9", "is not among what expressions may have"),
        ("[x for x in m.a]", "is not among what expressions may have"),
        ("m.a[m.b]", "is not among what expressions may have"),
        ("yaw(3) + m.a", "yaw(...) wants a quaternion"),
        ("m.a < " + "1" * 500, "at most 500 characters"),
    ],
)
def test_what_is_no_expression(text: str, said: str) -> None:
    with pytest.raises(MessageExpressionError) as error:
        MessageExpression(text)
    assert said in str(error.value)


@pytest.mark.parametrize(
    ("text", "value", "said"),
    [
        ("m.a / 0", 1, "division by zero"),
        ("m.a < 3", "text", "not supported between"),
        ("m.a * 3", "text", "a number is expected"),
        ("m.a", None, "m.a is not in this message"),
        ("max(m.a)", [], "empty"),
        ("sqrt(m.a)", -1, "m"),
    ],
)
def test_messages_for_which_there_is_no_value(text: str, value: Any, said: str) -> None:
    with pytest.raises(MessageExpressionError) as error:
        MessageExpression(text).value({"a": value})
    assert said in str(error.value)


@pytest.mark.parametrize("value", ["text", [1], math.nan, math.inf])
def test_what_is_no_number(value: Any) -> None:
    with pytest.raises(MessageExpressionError, match="is not a finite number"):
        MessageExpression("m.a").number({"a": value})


def test_what_fields_are_compared_with() -> None:
    found = MessageExpression("m.a == 'x' and -3 < m.b or m.c in ['y'] and m.d == m.a != True")
    assert found.compared == {"a": "a text", "b": "a number"}
