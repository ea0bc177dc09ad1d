"""Expressions over a ROS message `m`: `m.percentage < 0.2 and not m.present`.

A small part of Python, as `ros2 topic echo --filter` has it. Which fields are read is known before
a message comes, so only these pass the pipe.
"""

from __future__ import annotations

import ast
import math
import operator
from collections.abc import Callable, Mapping
from typing import Any

MAX_LENGTH = 500
MESSAGE = "m"

_BINARY: dict[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.FloorDiv: operator.floordiv,
    ast.Mod: operator.mod,
    ast.BitAnd: operator.and_,
}
_UNARY: dict[type[ast.unaryop], Callable[[Any], Any]] = {
    ast.Not: operator.not_,
    ast.USub: operator.neg,
    ast.UAdd: operator.pos,
}
_COMPARE: dict[type[ast.cmpop], Callable[[Any, Any], Any]] = {
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
    ast.In: lambda a, b: a in b,
    ast.NotIn: lambda a, b: a not in b,
}
_FUNCTIONS: dict[str, Callable[..., Any]] = {
    **{f.__name__: f for f in (abs, all, any, len, max, min, round, sum)},
    "hypot": math.hypot,
    "sqrt": math.sqrt,
}


class MessageExpressionError(Exception):
    """An expression that cannot be used, or has no value for a message; the text says why."""


class MessageExpression:
    """A compiled expression; `fields` are those of the message that it reads, e.g. `pose.x`."""

    def __init__(self, text: str) -> None:
        """Raises MessageExpressionError for anything but the part of Python that is meant."""
        self.text = text
        if len(text) > MAX_LENGTH:
            raise MessageExpressionError(f"an expression has at most {MAX_LENGTH} characters")
        try:
            self._tree = ast.parse(text, mode="eval").body
        except (SyntaxError, ValueError, RecursionError) as error:
            said = getattr(error, "msg", str(error))
            raise MessageExpressionError(f"{text!r} is no expression: {said}") from None
        found: dict[str, None] = {}
        _find_fields(self._tree, found)
        if not found:
            raise MessageExpressionError(f"{text!r} reads nothing of the message, e.g. m.data")
        self.fields = tuple(found)

    def value(self, fields: Mapping[str, Any]) -> Any:
        """Its value for these fields; raises MessageExpressionError where it has none."""
        try:
            return _value(self._tree, fields)
        except (ArithmeticError, TypeError, ValueError, KeyError) as error:
            raise MessageExpressionError(f"{self.text}: {error}") from None

    def truth(self, fields: Mapping[str, Any]) -> bool:
        """Whether it holds; raises MessageExpressionError."""
        return bool(self.value(fields))

    def number(self, fields: Mapping[str, Any]) -> float:
        """Its value as a finite number; raises MessageExpressionError."""
        found = self.value(fields)
        if not isinstance(found, int | float) or not math.isfinite(found):
            raise MessageExpressionError(f"{self.text}: {found!r:.60} is no finite number")
        return float(found)

    def entry(self, fields: Mapping[str, Any]) -> float | str:
        """Its value as a tree's entry holds it; raises MessageExpressionError."""
        found = self.value(fields)
        if not isinstance(found, int | float | str):
            raise MessageExpressionError(f"{self.text}: {found!r:.60} is no number, text or truth")
        return found


def _path(node: ast.expr) -> str | None:
    """`m.poses[0].x` -> `poses[0].x`; None for what is no field of the message."""
    steps: list[str] = []
    while True:
        if isinstance(node, ast.Attribute):
            steps.append(f".{node.attr}")
            node = node.value
        elif isinstance(node, ast.Subscript):
            index = _index(node.slice)
            if index is None:
                return None
            steps.append(f"[{index}]")
            node = node.value
        elif isinstance(node, ast.Name) and node.id == MESSAGE and steps:
            return "".join(reversed(steps)).removeprefix(".")
        else:
            return None


def _index(node: ast.expr) -> int | None:
    sign = 1
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        sign, node = -1, node.operand
    if isinstance(node, ast.Constant) and type(node.value) is int:
        return sign * node.value
    return None


def _is_yaw(node: ast.expr) -> bool:
    return isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "yaw"


def _find_fields(node: ast.expr, found: dict[str, None]) -> None:
    """Check that nothing else is in it, and note the fields."""
    path = _path(node)
    if path is not None:
        found[path] = None
        return
    children: list[ast.expr]
    match node:
        case ast.Constant(value=bool() | int() | float() | str()):
            children = []
        case ast.BoolOp(values=children):
            pass
        case ast.List(elts=children) | ast.Tuple(elts=children):
            pass
        case ast.UnaryOp(op=op, operand=operand) if type(op) in _UNARY:
            children = [operand]
        case ast.BinOp(left=left, op=binary, right=right) if type(binary) in _BINARY:
            children = [left, right]
        case ast.Compare(left=left, ops=ops, comparators=rest) if all(
            type(each) in _COMPARE for each in ops
        ):
            children = [left, *rest]
        case ast.Call(args=[quaternion], keywords=[]) if _is_yaw(node):
            whole = _path(quaternion)
            if whole is None:
                raise MessageExpressionError("yaw(...) wants a quaternion, e.g. m.orientation")
            found.update({f"{whole}.{axis}": None for axis in "xyzw"})
            return
        case ast.Call(func=ast.Name(id=name), args=children, keywords=[]) if name in _FUNCTIONS:
            pass
        case _:
            raise MessageExpressionError(_not_meant(node))
    for child in children:
        _find_fields(child, found)


def _not_meant(node: ast.expr) -> str:
    text = ast.unparse(node)
    if isinstance(node, ast.Call):
        known = ", ".join(sorted((*_FUNCTIONS, "yaw")))
        return f"{text!r}: the functions are {known}"
    if isinstance(node, ast.Name):
        return f"{text!r}: fields of the message are {MESSAGE}.NAME, e.g. {MESSAGE}.{text}"
    return f"{text!r} is not among what expressions may have (docs/how-to/ros2.md)"


def _value(node: ast.expr, fields: Mapping[str, Any]) -> Any:
    path = _path(node)
    if path is not None:
        found = fields[path]
        if found is None:
            raise ValueError(f"m.{path} is not in this message")
        return found
    match node:
        case ast.Constant(value=constant):
            return constant
        case ast.BoolOp(op=ast.And(), values=values):
            return all(_value(each, fields) for each in values)
        case ast.BoolOp(values=values):
            return any(_value(each, fields) for each in values)
        case ast.UnaryOp(op=op, operand=operand):
            return _UNARY[type(op)](_value(operand, fields))
        case ast.BinOp(left=left, op=binary, right=right):
            return _calculated(binary, _value(left, fields), _value(right, fields))
        case ast.Compare(left=left, ops=ops, comparators=rest):
            values = [_value(each, fields) for each in (left, *rest)]
            pairs = zip(ops, values, values[1:], strict=False)
            return all(_COMPARE[type(op)](a, b) for op, a, b in pairs)
        case ast.List(elts=items) | ast.Tuple(elts=items):
            return [_value(each, fields) for each in items]
        case ast.Call(args=arguments) if _is_yaw(node):
            x, y, z, w = (fields[f"{_path(arguments[0])}.{axis}"] for axis in "xyzw")
            return math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
        case ast.Call(func=ast.Name(id=name), args=arguments):
            return _FUNCTIONS[name](*(_value(each, fields) for each in arguments))
    raise AssertionError(f"{node!r} was let through")


def _calculated(kind: ast.operator, left: Any, right: Any) -> Any:
    """Texts and lists are not calculated with: they could be made long without end."""
    if not isinstance(left, int | float) or not isinstance(right, int | float):
        raise TypeError(f"numbers are expected, not {left!r:.40} and {right!r:.40}")
    return _BINARY[type(kind)](left, right)
