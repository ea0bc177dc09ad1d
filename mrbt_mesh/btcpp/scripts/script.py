"""BehaviorTree.CPP's scripting language: the syntax tree of a script, and how it is printed.

`parser.parse` makes a script, `evaluator.run_script` runs it. Source: the language reference in
BehaviorTree.CPP's documentation, and its grammar where the documentation says nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields, replace
from typing import Any, TypeAlias


class ScriptError(ValueError):
    """A script cannot be parsed or evaluated. `column` counts from 1; 0 if unknown."""

    def __init__(self, message: str, column: int = 0) -> None:
        super().__init__(f"{message} (column {column})" if column else message)
        self.column = column


@dataclass(frozen=True, slots=True)
class Number:
    """A literal number, never negative: `-1` is a `Unary`."""

    value: int | float


@dataclass(frozen=True, slots=True)
class Boolean:
    """`true` or `false`, which are 1.0 and 0.0."""

    value: bool


@dataclass(frozen=True, slots=True)
class String:
    """A quoted text. There are no escapes, so it cannot hold both kinds of quotes."""

    value: str


@dataclass(frozen=True, slots=True)
class Name:
    """A blackboard entry or an enum; `@name` is an entry of the root blackboard."""

    name: str


@dataclass(frozen=True, slots=True)
class Unary:
    """`-x`, `~x` or `!x`."""

    operator: str
    operand: Expression


@dataclass(frozen=True, slots=True)
class Binary:
    """Arithmetic and bitwise operators, `..`, `&&` and `||`; both sides are always evaluated."""

    operator: str
    left: Expression
    right: Expression


@dataclass(frozen=True, slots=True)
class Comparison:
    """`a < b <= c`: every adjacent pair must hold. There is one more operand than operators."""

    operators: tuple[str, ...]
    operands: tuple[Expression, ...]


@dataclass(frozen=True, slots=True)
class Conditional:
    """`condition ? then : otherwise`."""

    condition: Expression
    then: Expression
    otherwise: Expression


@dataclass(frozen=True, slots=True)
class Assign:
    """An assignment. `name := value` creates the entry; other operators need it to exist."""

    operator: str
    name: str
    value: Expression


@dataclass(frozen=True, slots=True)
class Impossible:
    """An assignment to something that is not an entry: it can be parsed, but fails when run."""

    left: Expression
    operator: str
    right: Expression


Expression: TypeAlias = (
    Number
    | Boolean
    | String
    | Name
    | Unary
    | Binary
    | Comparison
    | Conditional
    | Assign
    | Impossible
)

ASSIGNMENTS = frozenset({":=", "=", "+=", "-=", "*=", "/="})
COMPARISONS = frozenset({"==", "!=", "<", "<=", ">", ">="})
LOGICAL = frozenset({"&&", "||"})
BITS = frozenset({"&", "|", "^"})
# Precedence of operators. Unlike in C, `|` and `^` have the same one, and so have all comparisons.
LEVELS = {
    **dict.fromkeys(ASSIGNMENTS, 1),
    "?": 2,
    "||": 3,
    "&&": 4,
    **dict.fromkeys(COMPARISONS, 5),
    "|": 6,
    "^": 6,
    "&": 7,
    "..": 8,
    "+": 8,
    "-": 8,
    "*": 9,
    "/": 9,
}
PREFIX_LEVEL, ATOM_LEVEL = 10, 11


@dataclass(frozen=True, slots=True)
class Script:
    """One or more statements; the value of the script is that of the last one."""

    statements: tuple[Expression, ...]

    def __str__(self) -> str:
        return "; ".join(_print(statement) for statement in self.statements)

    def expressions(self) -> Iterator[Expression]:
        """Yield every expression of the script, outer ones first."""
        waiting = list(reversed(self.statements))
        while waiting:
            expression = waiting.pop()
            yield expression
            waiting.extend(reversed(_parts(expression)))

    @property
    def written(self) -> frozenset[str]:
        """The names that the script assigns to. A script without any has no side effect."""
        return frozenset(e.name for e in self.expressions() if isinstance(e, Assign))

    @property
    def read(self) -> frozenset[str]:
        """The names whose values the script uses; `x += 1` uses x."""
        names = {e.name for e in self.expressions() if isinstance(e, Name)}
        changed = {
            e.name
            for e in self.expressions()
            if isinstance(e, Assign) and e.operator not in (":=", "=")
        }
        return frozenset(names | changed)


def renamed(script: Script, rename: Callable[[str], str]) -> Script:
    """Return the script with every name, read or written, replaced by `rename(name)`."""
    return Script(tuple(_renamed(statement, rename) for statement in script.statements))


def _renamed(expression: Expression, rename: Callable[[str], str]) -> Expression:
    changed: dict[str, Any] = {}
    for each in fields(expression):
        value = getattr(expression, each.name)
        if isinstance(value, tuple):
            parts = (_renamed(p, rename) if isinstance(p, Expression) else p for p in value)
            changed[each.name] = tuple(parts)
        elif isinstance(value, Expression):
            changed[each.name] = _renamed(value, rename)
    if isinstance(expression, Name | Assign):
        changed["name"] = rename(expression.name)
    return replace(expression, **changed)


def _parts(expression: Expression) -> list[Expression]:
    parts: list[Expression] = []
    for each in fields(expression):
        value = getattr(expression, each.name)
        values = value if isinstance(value, tuple) else (value,)
        parts += (part for part in values if isinstance(part, Expression))
    return parts


def level(expression: Expression) -> int:
    """Return the precedence of the outermost operator of `expression`."""
    if isinstance(expression, Binary | Assign | Impossible):
        return LEVELS[expression.operator]
    if isinstance(expression, Comparison):
        return LEVELS["=="]
    if isinstance(expression, Conditional):
        return LEVELS["?"]
    return PREFIX_LEVEL if isinstance(expression, Unary) else ATOM_LEVEL


def _print(expression: Expression) -> str:
    if isinstance(expression, Number):
        return repr(expression.value)
    if isinstance(expression, Boolean):
        return "true" if expression.value else "false"
    if isinstance(expression, String):
        quote = '"' if "'" in expression.value else "'"
        return f"{quote}{expression.value}{quote}"
    if isinstance(expression, Name):
        return expression.name
    if isinstance(expression, Unary):
        return expression.operator + _operand(expression.operand, ATOM_LEVEL)
    if isinstance(expression, Assign):
        return f"{expression.name} {expression.operator} {_print(expression.value)}"
    if isinstance(expression, Impossible):
        left = _operand(expression.left, LEVELS["||"])
        return f"{left} {expression.operator} {_print(expression.right)}"
    if isinstance(expression, Conditional):
        condition = _operand(expression.condition, LEVELS["||"])
        otherwise = _operand(expression.otherwise, LEVELS["?"])
        return f"{condition} ? {_print(expression.then)} : {otherwise}"
    if isinstance(expression, Comparison):
        first, *others = (_operand(part, LEVELS["|"]) for part in expression.operands)
        return first + "".join(
            f" {operator} {other}"
            for operator, other in zip(expression.operators, others, strict=True)
        )
    here = LEVELS[expression.operator]
    left, right = _operand(expression.left, here), _operand(expression.right, here + 1)
    return f"{left} {expression.operator} {right}"


def _operand(expression: Expression, at_least: int) -> str:
    text = _print(expression)
    return f"({text})" if level(expression) < at_least else text
