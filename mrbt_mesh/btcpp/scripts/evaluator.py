"""Evaluate BehaviorTree.CPP's scripts over the entries of a blackboard.

Values stand for C++ values: an `int` is an int64_t, a `float` a double, and `None` an entry that
was declared but never written. `values` converts between them.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Mapping
from typing import Any, Protocol, TypeAlias

from mrbt_mesh.btcpp.scripts.script import (
    BITS,
    LOGICAL,
    Assign,
    Binary,
    Boolean,
    Comparison,
    Conditional,
    Expression,
    Impossible,
    Name,
    Number,
    Script,
    ScriptError,
    String,
    Unary,
)
from mrbt_mesh.btcpp.scripts.values import (
    ANY_TYPE,
    INT64,
    ValueTypeError,
    as_integer,
    as_number,
    as_text,
    as_truth,
    copied_into,
    read_text,
)

Value: TypeAlias = int | float | str

# BehaviorTree.CPP treats numbers this close as equal: C++'s float epsilon.
EPSILON = 2.0**-23

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
_ORDER: Mapping[str, Callable[[Any, Any], bool]] = {
    # Negated as in BehaviorTree.CPP: every comparison with NaN is true.
    "<": lambda left, right: not left >= right,
    ">": lambda left, right: not left <= right,
    "<=": lambda left, right: not left > right,
    ">=": lambda left, right: not left < right,
}


class Entries(Protocol):
    """A blackboard as a script sees it. Names may begin with `@`: the root's entries."""

    def __contains__(self, name: str) -> bool: ...
    def read(self, name: str) -> Any:
        """Return the value of an existing entry; None if it was never written."""
        ...

    def type_of(self, name: str) -> str:
        """Return the entry's C++ type, empty if it has none."""
        ...

    def write(self, name: str, value: Any) -> None:
        """Set an entry; create it if needed."""
        ...

    def declare(self, name: str) -> object:
        """Create an untyped entry, unless it exists."""
        ...


def run_script(script: Script, entries: Entries, enums: Mapping[str, int]) -> Any:
    """Run a script and return its last value; truth values are 1.0 and 0.0.

    Raises ScriptError, also for errors that BehaviorTree.CPP reports at run time: missing entries
    and wrong types.
    """
    run = _Run(entries, enums)
    value: Any = None
    try:
        for statement in script.statements:
            value = run.value(statement)
    except ValueTypeError as error:
        raise ScriptError(str(error)) from None
    return value


def is_true(value: Any) -> bool:
    """Return whether a condition with this value holds: 1, or a positive real number.

    Raises ScriptError for a text, a negative real number, and an integer other than 0 and 1.
    """
    try:
        return as_truth(value)
    except ValueTypeError as error:
        raise ScriptError(str(error)) from None


def _divide(left: float, right: float) -> float:
    if right != 0:
        return left / right
    if left == 0 or math.isnan(left):
        return math.nan
    return math.copysign(math.inf, left) * math.copysign(1.0, right)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float)


class _Run:
    def __init__(self, entries: Entries, enums: Mapping[str, int]) -> None:
        self.entries = entries
        self.enums = enums

    def value(self, expression: Expression) -> Any:
        if isinstance(expression, Number | String):
            return expression.value
        if isinstance(expression, Boolean):
            return float(expression.value)
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
            condition = as_number(self.value(expression.condition))
            return self.value(expression.then if condition else expression.otherwise)
        if isinstance(expression, Impossible):
            raise ScriptError(f"only a blackboard entry can stand before {expression.operator!r}")
        return self.assign(expression)

    def named(self, name: str) -> Any:
        if name in self.enums:
            return float(self.enums[name])
        if name not in self.entries:
            raise ScriptError(f"there is no blackboard entry {name!r}")
        return self.entries.read(name)

    def unary(self, expression: Unary) -> float:
        value, symbol = self.value(expression.operand), expression.operator
        if not _is_number(value):
            raise ScriptError(f"{symbol!r} needs a number, not {_described(value)}")
        number = as_number(value)
        if symbol == "-":
            return -number
        if symbol == "!":
            return float(not number)
        if math.isnan(number) or not INT64.start <= number <= INT64.stop:
            raise ScriptError(f"'~': {value!r} is out of the range of 64 bits")
        return float(~min(int(number), INT64.stop - 1))

    def binary(self, symbol: str, left: Any, right: Any) -> Any:
        _check_set(symbol, left, right)
        if _is_number(left) and _is_number(right):
            if symbol in _ARITHMETIC:
                return _ARITHMETIC[symbol](as_number(left), as_number(right))
            if symbol in BITS:
                return float(_BITWISE[symbol](as_integer(left), as_integer(right)))
            if symbol in LOGICAL:
                both = as_truth(left), as_truth(right)
                return float(all(both) if symbol == "&&" else any(both))
            return None  # As in BehaviorTree.CPP: joining two numbers has no value.
        texts = isinstance(left, str) + isinstance(right, str)
        numbers = _is_number(left) + _is_number(right)
        if (symbol == "+" and texts == 2) or (symbol == ".." and texts + numbers == 2):
            return as_text(left) + as_text(right)
        raise ScriptError(f"{_described(left)} {symbol} {_described(right)} is not possible")

    def comparison(self, expression: Comparison) -> float:
        left = self.value(expression.operands[0])
        for symbol, operand in zip(expression.operators, expression.operands[1:], strict=True):
            right = self.value(operand)
            _check_set(symbol, left, right)
            if not self.holds(symbol, left, right):
                return 0.0
            left = right
        return 1.0

    def holds(self, symbol: str, left: Any, right: Any) -> bool:
        both_texts = isinstance(left, str) and isinstance(right, str)
        first, second = (left, right) if both_texts else (self.number(left), self.number(right))
        if symbol in ("==", "!="):
            equal = first == second if both_texts else abs(first - second) <= EPSILON
            return bool(equal) is (symbol == "==")
        return _ORDER[symbol](first, second)

    def number(self, value: Any) -> float:
        """Convert a value to a number. A text is true, false, an enum's name or a number."""
        if value in ("true", "false"):
            return float(value == "true")
        if isinstance(value, str) and value in self.enums:
            return float(self.enums[value])
        return as_number(value)

    def assign(self, expression: Assign) -> Any:
        name, symbol = expression.name, expression.operator
        if name not in self.entries:
            if symbol != ":=":
                raise ScriptError(f"there is no blackboard entry {name!r}; ':=' creates one")
            self.entries.declare(name)
        value = self.value(expression.value)
        if value is None:
            raise ScriptError(f"the right operand of {symbol!r} has no value")
        before = self.entries.read(name)
        if symbol in (":=", "="):
            after = self.replaced(name, before, value)
        else:
            after = copied_into(before, self.changed(name, before, symbol, value))
        self.entries.write(name, after)
        return after

    def replaced(self, name: str, before: Any, value: Any) -> Any:
        """Return the value of an entry after `=` or `:=`; the entry keeps its type."""
        entry_type = self.entries.type_of(name)
        if before is None and not entry_type:
            return value
        if isinstance(value, str) and not isinstance(before, str):
            if entry_type == ANY_TYPE:
                raise ScriptError(f"a text cannot be converted to the type {ANY_TYPE} of {name!r}")
            if entry_type:
                return read_text(value, entry_type, self.enums)
            return self.number(value) if _is_number(before) else value
        return copied_into(before, value)

    def changed(self, name: str, before: Any, symbol: str, value: Any) -> Any:
        """Return the value of x after `x += value`, `-=`, `*=` or `/=`."""
        if before is None:
            raise ScriptError(f"the entry {name!r} has no value")
        if _is_number(value):
            if not _is_number(before):
                raise ScriptError(f"{symbol!r} needs a number in {name!r}, which holds a text")
            return _ARITHMETIC[symbol[0]](as_number(before), as_number(value))
        if symbol != "+=":
            raise ScriptError(f"{symbol!r} needs a number, not {_described(value)}")
        return as_text(before) + as_text(value)


def _check_set(symbol: str, left: Any, right: Any) -> None:
    for side, value in (("left", left), ("right", right)):
        if value is None:
            raise ScriptError(f"the {side} operand of {symbol!r} has no value")


def _described(value: Any) -> str:
    return f"the text {value!r}" if isinstance(value, str) else repr(value)
