"""Evaluate BehaviorTree.CPP's scripts over a blackboard that is a plain mapping."""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Mapping, MutableMapping
from typing import TypeAlias

from mrbt_mesh.formats.btcpp.script import (
    BITS,
    LOGICAL,
    Assign,
    Binary,
    Boolean,
    Comparison,
    Conditional,
    Expression,
    Name,
    Number,
    Script,
    ScriptError,
    String,
    Unary,
)
from mrbt_mesh.formats.btcpp.script_parser import parse

Value: TypeAlias = int | float | str

# BehaviorTree.CPP takes numbers that are this close for equal: C++'s float epsilon.
EPSILON = 2.0**-23
_INT64 = range(-(2**63), 2**63)

_ARITHMETIC: Mapping[str, Callable[[float, float], float]] = {
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
    "/": lambda left, right: _divide(left, right),
}
_BITWISE: Mapping[str, Callable[[int, int], int]] = {
    "&": operator.and_,
    "|": operator.or_,
    "^": operator.xor,
}
_ORDER: Mapping[str, Callable[[bool, bool], bool]] = {
    # Of (is less, is greater).
    "<": lambda less, greater: less,
    ">": lambda less, greater: greater,
    "<=": lambda less, greater: not greater,
    ">=": lambda less, greater: not less,
}


def evaluate(
    script: Script | str,
    blackboard: MutableMapping[str, Value],
    enums: Mapping[str, int] | None = None,
    root: MutableMapping[str, Value] | None = None,
) -> Value:
    """Run a script and return its last value; truth values are 1.0 and 0.0.

    `@name` is an entry of `root`, which is `blackboard` unless given. Raises ScriptError, also
    for what BehaviorTree.CPP refuses at run time: missing entries, wrong types.
    """
    parsed = parse(script) if isinstance(script, str) else script
    run = _Run(blackboard, enums or {}, blackboard if root is None else root)
    value: Value = 0.0
    for statement in parsed.statements:
        value = run.value(statement)
    return value


def is_true(value: Value) -> bool:
    """Whether a condition with this value holds: a number that is not 0."""
    if isinstance(value, str):
        raise ScriptError(f"the text {value!r} is neither true nor false")
    return value != 0


def _divide(left: float, right: float) -> float:
    if right != 0:
        return left / right
    return math.nan if left == 0 or math.isnan(left) else math.copysign(math.inf, left)


def _as_text(value: Value) -> str:
    """As C++'s std::to_string writes it: 6 decimals for a number that is no integer."""
    if isinstance(value, str):
        return value
    return f"{value:f}" if isinstance(value, float) else str(int(value))


def _as_integer(value: Value, symbol: str) -> int:
    if isinstance(value, str) or not math.isfinite(value) or value != int(value):
        raise ScriptError(f"{symbol!r} needs integers, not {value!r}")
    if int(value) not in _INT64:
        raise ScriptError(f"{symbol!r}: {value!r} is out of the range of 64 bits")
    return int(value)


class _Run:
    def __init__(
        self,
        blackboard: MutableMapping[str, Value],
        enums: Mapping[str, int],
        root: MutableMapping[str, Value],
    ) -> None:
        self.blackboard = blackboard
        self.enums = enums
        self.root = root

    def value(self, expression: Expression) -> Value:
        if isinstance(expression, Number | String):
            return expression.value
        if isinstance(expression, Boolean):
            return int(expression.value)
        if isinstance(expression, Name):
            return self.named(expression.name)
        if isinstance(expression, Unary):
            return self.unary(expression)
        if isinstance(expression, Binary):
            left, right = self.value(expression.left), self.value(expression.right)
            return self.binary(expression.operator, left, right)
        if isinstance(expression, Comparison):
            return self.comparison(expression)
        if isinstance(expression, Conditional):
            condition = self.value(expression.condition)
            return self.value(expression.then if condition else expression.otherwise)
        return self.assign(expression)

    def place(self, name: str) -> tuple[MutableMapping[str, Value], str]:
        return (self.root, name[1:]) if name.startswith("@") else (self.blackboard, name)

    def named(self, name: str) -> Value:
        if name in self.enums:
            return float(self.enums[name])
        entries, key = self.place(name)
        if key not in entries:
            raise ScriptError(f"there is no blackboard entry {name!r}")
        return entries[key]

    def unary(self, expression: Unary) -> Value:
        value = self.value(expression.operand)
        if isinstance(value, str):
            raise ScriptError(f"{expression.operator!r} needs a number, not the text {value!r}")
        if expression.operator == "-":
            return -float(value)
        if expression.operator == "!":
            return float(not value)
        if not math.isfinite(value) or int(value) not in _INT64:
            raise ScriptError(f"'~': {value!r} is out of the range of 64 bits")
        return float(~int(value))

    def binary(self, symbol: str, left: Value, right: Value) -> Value:
        texts = isinstance(left, str) + isinstance(right, str)
        if (symbol == ".." and texts) or (symbol == "+" and texts == 2):
            return _as_text(left) + _as_text(right)
        if isinstance(left, str) or isinstance(right, str) or symbol == "..":
            raise ScriptError(f"{left!r} {symbol} {right!r} is not possible")
        if symbol in BITS:
            bits = _BITWISE[symbol](_as_integer(left, symbol), _as_integer(right, symbol))
            return float(bits)
        if symbol in LOGICAL:
            both = (left != 0, right != 0)
            return float(all(both) if symbol == "&&" else any(both))
        return _ARITHMETIC[symbol](float(left), float(right))

    def comparison(self, expression: Comparison) -> Value:
        left = self.value(expression.operands[0])
        for symbol, operand in zip(expression.operators, expression.operands[1:], strict=True):
            right = self.value(operand)
            if not self.holds(symbol, left, right):
                return 0.0
            left = right
        return 1.0

    def holds(self, symbol: str, left: Value, right: Value) -> bool:
        if isinstance(left, str) and isinstance(right, str):
            equal, less, greater = left == right, left < right, left > right
        else:
            first, second = self.number(left), self.number(right)
            equal = abs(first - second) <= EPSILON
            less, greater = first < second, first > second
        if symbol in ("==", "!="):
            return equal is (symbol == "==")
        return _ORDER[symbol](less, greater)

    def number(self, value: Value) -> float:
        """A text next to a number is an enum's name or a number."""
        if not isinstance(value, str):
            return float(value)
        if value in self.enums:
            return float(self.enums[value])
        try:
            return float(value)
        except ValueError:
            raise ScriptError(f"the text {value!r} is compared with a number") from None

    def assign(self, expression: Assign) -> Value:
        entries, key = self.place(expression.name)
        symbol = expression.operator
        if symbol != ":=" and key not in entries:
            raise ScriptError(f"there is no blackboard entry {expression.name!r}; ':=' creates one")
        value = self.value(expression.value)
        before = entries.get(key)
        if symbol in (":=", "="):
            is_number = before is not None and not isinstance(before, str)
            if isinstance(value, str) and is_number:
                value = self.number(value)
            elif isinstance(before, str) and not isinstance(value, str):
                value = _as_text(value)
        else:
            assert before is not None
            value = self.changed(expression.name, before, symbol, value)
        entries[key] = value
        return value

    def changed(self, name: str, before: Value, symbol: str, value: Value) -> Value:
        """What `x += value` and its kin make of x."""
        if isinstance(value, str):
            if symbol != "+=":
                raise ScriptError(f"{symbol!r} needs a number, not the text {value!r}")
            return _as_text(before) + value
        if isinstance(before, str):
            raise ScriptError(f"{symbol!r} needs a number in {name!r}, which holds a text")
        return _ARITHMETIC[symbol[0]](float(before), float(value))
