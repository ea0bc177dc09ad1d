"""Expressions over a ROS message `m`: `m.percentage < 0.2 and not m.present`.

The syntax is a small part of Python, like that of `ros2 topic echo --filter`. The fields that an
expression reads are known before a message arrives, so only they are sent through the pipe.
"""

from __future__ import annotations

import ast
import math
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

MAX_LENGTH = 500
MESSAGE = "m"

# Syntax nodes that are allowed in an expression but are not expressions themselves.
_REST = (
    *(ast.expr_context, ast.And, ast.Or, ast.Not, ast.USub, ast.UAdd),
    *(ast.Add, ast.Sub, ast.Mult, ast.Div, ast.FloorDiv, ast.Mod, ast.BitAnd),
    *(ast.Eq, ast.NotEq, ast.Lt, ast.LtE, ast.Gt, ast.GtE, ast.In, ast.NotIn),
)
_FUNCTIONS: dict[str, Callable[..., Any]] = {
    **{f.__name__: f for f in (abs, all, any, len, max, min, round, sum)},
    "hypot": math.hypot,
    "sqrt": math.sqrt,
}


class MessageExpressionError(Exception):
    """An expression is invalid, or has no value for a message; the text is the reason."""


class MessageExpression:
    """A compiled expression.

    `fields` are the message fields that it reads, e.g. `pose.x`. `compared` maps fields to
    `a text` or `a number`, the kind of constant with which they are compared.
    """

    def __init__(self, text: str) -> None:
        """Compile a text. Raises MessageExpressionError for syntax that is not allowed."""
        self.text = text
        if len(text) > MAX_LENGTH:
            raise MessageExpressionError(f"an expression has at most {MAX_LENGTH} characters")
        allowed = _Allowed()
        try:
            tree = allowed.visit(ast.parse(text, mode="eval").body)
            code = compile(ast.fix_missing_locations(ast.Expression(tree)), "<expression>", "eval")
        except (SyntaxError, ValueError, RecursionError) as error:
            said = getattr(error, "msg", str(error))
            raise MessageExpressionError(f"{text!r} is not an expression: {said}") from None
        if not allowed.fields:
            raise MessageExpressionError(f"{text!r} reads nothing of the message, e.g. m.data")
        self.fields = tuple(allowed.fields)
        self.compared = allowed.compared
        self._code = code

    def value(self, fields: Mapping[str, Any]) -> Any:
        """Return the value for these fields. Raises MessageExpressionError if there is none."""
        try:
            return eval(self._code, {**_NAMES, "field": partial(_field, fields)})
        except (ArithmeticError, TypeError, ValueError, KeyError) as error:
            raise MessageExpressionError(f"{self.text}: {error}") from None

    def truth(self, fields: Mapping[str, Any]) -> bool:
        """Return whether the expression is true. Raises MessageExpressionError."""
        return bool(self.value(fields))

    def number(self, fields: Mapping[str, Any]) -> float:
        """Return the value as a finite number. Raises MessageExpressionError."""
        found = self.value(fields)
        if not isinstance(found, int | float) or not math.isfinite(found):
            raise MessageExpressionError(f"{self.text}: {found!r:.60} is not a finite number")
        return float(found)

    def entry(self, fields: Mapping[str, Any]) -> float | str:
        """Return the value for a tree's entry, a number or text. Raises MessageExpressionError."""
        found = self.value(fields)
        if not isinstance(found, int | float | str):
            raise MessageExpressionError(
                f"{self.text}: {found!r:.60} is not a number, text or truth"
            )
        return found


def _path(node: ast.expr) -> str | None:
    """Convert `m.poses[0].x` to `poses[0].x`; None for anything but a message field."""
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


class _Allowed(ast.NodeTransformer):
    """Refuses all but the allowed part of Python; replaces message fields by look-ups."""

    def __init__(self) -> None:
        self.fields: dict[str, None] = {}
        self.compared: dict[str, str] = {}

    def visit(self, node: Any) -> Any:
        """Return the node to evaluate. Raises MessageExpressionError."""
        if isinstance(node, _REST):
            return node
        path = _path(node)
        if path is not None:
            return self._field(path)
        has_operators = all(isinstance(e, (ast.expr, *_REST)) for e in ast.iter_child_nodes(node))
        match node:
            case ast.Constant(value=bool() | int() | float() | str()):
                return node
            case ast.Call(func=ast.Name(id="yaw"), args=[quaternion], keywords=[]):
                whole = _path(quaternion)
                if whole is None:
                    raise MessageExpressionError("yaw(...) wants a quaternion, e.g. m.orientation")
                return _call("yaw", *(self._field(f"{whole}.{axis}") for axis in "xyzw"))
            case ast.Call(func=ast.Name(id=name), args=args, keywords=[]) if name in _FUNCTIONS:
                return _call(name, *map(self.visit, args))
            case ast.BinOp() if has_operators:
                # Numbers only: operators on texts and lists could make them arbitrarily long.
                left, right = (_call("number", self.visit(e)) for e in (node.left, node.right))
                return ast.BinOp(left, node.op, right)
            case ast.List(elts=items) | ast.Tuple(elts=items):
                return ast.List(list(map(self.visit, items)), ast.Load())
            case ast.Compare() if has_operators:
                self._note_compared(node)
                return self.generic_visit(node)
            case ast.BoolOp() | ast.UnaryOp() if has_operators:
                return self.generic_visit(node)
        raise MessageExpressionError(_refusal(node))

    def _note_compared(self, node: ast.Compare) -> None:
        sides = [node.left, *node.comparators]
        for left, operator, right in zip(sides, node.ops, sides[1:], strict=False):
            if isinstance(operator, ast.In | ast.NotIn):
                continue
            for one, other in ((left, right), (right, left)):
                path, kind = _path(one), _constant_kind(other)
                if path is not None and kind:
                    self.compared[path] = kind

    def _field(self, path: str) -> ast.expr:
        self.fields[path] = None
        return _call("field", ast.Constant(path))


def _call(name: str, *arguments: ast.expr) -> ast.expr:
    return ast.Call(ast.Name(name, ast.Load()), list(arguments), [])


def _constant_kind(node: ast.expr) -> str:
    if isinstance(node, ast.UnaryOp):
        node = node.operand
    if not isinstance(node, ast.Constant) or isinstance(node.value, bool):
        return ""
    return "a text" if isinstance(node.value, str) else "a number"


def _refusal(node: ast.expr) -> str:
    text = ast.unparse(node)
    if isinstance(node, ast.Call):
        known = ", ".join(sorted((*_FUNCTIONS, "yaw")))
        return f"{text!r}: the functions are {known}"
    if isinstance(node, ast.Name):
        return f"{text!r}: fields of the message are {MESSAGE}.NAME, e.g. {MESSAGE}.{text}"
    return f"{text!r} is not among what expressions may have (docs/how-to/ros2.md)"


def _field(fields: Mapping[str, Any], path: str) -> Any:
    found = fields[path]
    if found is None:
        raise ValueError(f"m.{path} is not in this message")
    return found


def _number(value: Any) -> Any:
    if not isinstance(value, int | float):
        raise TypeError(f"a number is expected, not {value!r:.40}")
    return value


def _yaw(x: float, y: float, z: float, w: float) -> float:
    return math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))


_NAMES = {"__builtins__": {}, "number": _number, "yaw": _yaw, **_FUNCTIONS}
