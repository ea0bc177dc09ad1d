"""Parses BehaviorTree.CPP's scripts: a lexer and a precedence-climbing parser."""

from __future__ import annotations

import re
from dataclasses import dataclass

from mrbt_mesh.btcpp.scripts.script import (
    ASSIGNMENTS,
    COMPARISONS,
    LEVELS,
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
from mrbt_mesh.btcpp.scripts.values import read_real

MAX_CHARACTERS = 20_000
MAX_NESTING = 60
MAX_OPERATORS = 200
MAX_INTEGER = 2**63 - 1

_HEX = re.compile(r"0[xX][0-9a-fA-F]+", re.ASCII)
_REAL = re.compile(r"[0-9]+(\.[0-9]+([eE][+-]?[0-9]+)?|[eE][+-]?[0-9]+)", re.ASCII)
_INTEGER = re.compile(r"[0-9]+", re.ASCII)
# Longer operators first.
_OPERATORS = re.compile(r":=|[-+*/]=|[=!<>]=|&&|\|\||\.\.|[-=<>+*/&|^~!?:;()]")


@dataclass(frozen=True, slots=True)
class _Token:
    """`kind` is `number`, `text`, `name`, `operator` or `end`."""

    kind: str
    text: str
    column: int
    value: int | float | str = ""

    def __str__(self) -> str:
        return "the end of the script" if self.kind == "end" else repr(self.text)


def parse(text: str) -> Script:
    """Parse a script. Raises ScriptError with the column of the error."""
    if len(text) > MAX_CHARACTERS:
        raise ScriptError(f"a script of more than {MAX_CHARACTERS} characters")
    return _Parser(_tokens(text)).script()


def dialect_problem(text: str) -> str:
    """Return why BehaviorTree.CPP refuses a script that this parser reads; "" if it does not.

    BehaviorTree.CPP accepts only texts in single quotes, ASCII names, and neither form feeds,
    vertical tabs nor backslashes between tokens. Raises ScriptError.
    """
    between = text
    for token in _tokens(text):
        if token.kind == "text" and token.text[0] == '"':
            return f"BehaviorTree.CPP refuses a text in double quotes, {token}; use single ones"
        if token.kind == "name" and not token.text.isascii():
            return f"BehaviorTree.CPP refuses the name {token}, which is not ASCII"
        if token.kind == "text":
            between = between.replace(token.text, "", 1)
    for odd in ("\\", "\f", "\v"):
        if odd in between:
            return f"BehaviorTree.CPP refuses {odd!r} between the parts of a script"
    return ""


def single_quoted(text: str) -> str:
    """Return the script with texts in single quotes where possible. Raises ScriptError."""
    kept = text
    for token in reversed(_tokens(text)):
        if token.kind == "text" and token.text[0] == '"' and "'" not in token.text:
            start = token.column - 1
            end = start + len(token.text)
            kept = f"{kept[:start]}'{token.value}'{kept[end:]}"
    return kept


def _tokens(text: str) -> list[_Token]:
    tokens = []
    position = 0
    while position < len(text):
        character = text[position]
        if character in " \t\r\n\f\v":
            position += 1
        elif text.startswith(("\\\n", "\\\r\n"), position):
            position = text.index("\n", position) + 1
        else:
            token = _token(text, position)
            tokens.append(token)
            position += len(token.text)
    tokens.append(_Token("end", "", len(text) + 1))
    return tokens


def _token(text: str, start: int) -> _Token:
    character = text[start]
    column = start + 1
    if character.isdigit() and character.isascii():
        return _number(text, start)
    if character in "'\"":
        end = text.find(character, start + 1)
        if end < 0:
            raise ScriptError(f"the text is not closed: {character} is missing", column)
        return _Token("text", text[start : end + 1], column, text[start + 1 : end])
    if character == "@" or character.isidentifier():
        end = start + 1
        while end < len(text) and ("a" + text[end]).isidentifier():
            end += 1
        return _Token("name", text[start:end], column)
    if operator := _OPERATORS.match(text, start):
        return _Token("operator", operator[0], column)
    raise ScriptError(f"{character!r} has no meaning in a script", column)


def _number(text: str, start: int) -> _Token:
    column = start + 1
    value: int | float
    if match := _HEX.match(text, start):
        value = int(match[0], 16)
    elif match := _REAL.match(text, start):
        value = float(match[0])
    else:
        match = _INTEGER.match(text, start)
        assert match is not None
        # Python refuses to convert a number of thousands of digits.
        value = int(match[0]) if len(match[0]) < 30 else MAX_INTEGER + 1
    after = text[match.end() : match.end() + 1]
    joins = text.startswith("..", match.end()) and match.re is not _HEX
    is_period = after == "." and not joins
    if after and (is_period or ("a" + after).isidentifier()):
        raise ScriptError(f"{after!r} cannot follow the number {match[0][:30]}", match.end() + 1)
    if isinstance(value, float) and read_real(match[0]) is None:
        raise ScriptError(f"a number that is too {'large' if value else 'small'}", column)
    if isinstance(value, int) and value > MAX_INTEGER:
        raise ScriptError("a number that is too large", column)
    return _Token("number", match[0], column, value)


class _Parser:
    def __init__(self, tokens: list[_Token]) -> None:
        self.tokens = tokens
        self.position = 0
        self.nesting = 0
        self.operators = 0

    @property
    def next(self) -> _Token:
        return self.tokens[self.position]

    def take(self) -> _Token:
        token = self.next
        self.position += 1
        return token

    def accept(self, *operators: str) -> _Token | None:
        if self.next.kind == "operator" and self.next.text in operators:
            return self.take()
        return None

    def expect(self, operator: str, what_for: str) -> None:
        if not self.accept(operator):
            raise ScriptError(
                f"{operator!r} expected {what_for}, found {self.next}", self.next.column
            )

    def script(self) -> Script:
        statements = [self.expression()]
        self.skip_semicolons()
        while self.next.kind != "end":
            self.operators = 0
            statements.append(self.expression())
            self.skip_semicolons()
        return Script(tuple(statements))

    def skip_semicolons(self) -> None:
        """Skip any number of semicolons after a statement."""
        while self.accept(";"):
            pass

    def expression(self) -> Expression:
        """Parse an assignment, or an expression that binds tighter."""
        self.nest(self.next)
        left = self.binary(LEVELS["||"])
        if self.accept("?"):
            # No assignment can follow a conditional, not even an impossible one.
            left = self.conditional(left)
        elif operator := self.accept(*ASSIGNMENTS):
            self.count(operator)
            right = self.expression()
            if isinstance(left, Name):
                left = Assign(operator.text, left.name, right)
            else:
                left = Impossible(left, operator.text, right)
        self.nesting -= 1
        return left

    def conditional(self, condition: Expression) -> Expression:
        """Parse the rest of a conditional after `condition ?`."""
        self.nest(self.next)
        then = self.expression()
        self.expect(":", "between the two values of '?'")
        otherwise = self.binary(LEVELS["||"])
        if self.accept("?"):
            otherwise = self.conditional(otherwise)
        self.nesting -= 1
        return Conditional(condition, then, otherwise)

    def binary(self, lowest: int) -> Expression:
        """Parse operators that bind at least as tightly as `lowest`, from left to right."""
        left = self.prefix()
        while self.next.kind == "operator" and LEVELS.get(self.next.text, 0) >= lowest:
            operator = self.take()
            self.count(operator)
            right = self.binary(LEVELS[operator.text] + 1)
            if operator.text in COMPARISONS:
                left = self.comparison(operator, left, right)
            else:
                left = Binary(operator.text, left, right)
        return left

    def comparison(self, first: _Token, left: Expression, right: Expression) -> Expression:
        """Parse further comparisons as part of the same chain."""
        operators, operands = [first.text], [left, right]
        while operator := self.accept(*COMPARISONS):
            self.count(operator)
            operators.append(operator.text)
            operands.append(self.binary(LEVELS[operator.text] + 1))
        return Comparison(tuple(operators), tuple(operands))

    def prefix(self) -> Expression:
        if operator := self.accept("-", "!", "~"):
            self.nest(operator)
            operand = self.prefix()
            self.nesting -= 1
            return Unary(operator.text, operand)
        return self.atom()

    def nest(self, token: _Token) -> None:
        self.nesting += 1
        if self.nesting > MAX_NESTING:
            raise ScriptError(f"nested deeper than {MAX_NESTING} levels", token.column)

    def count(self, operator: _Token) -> None:
        """Count an operator: chains of operators also nest, to the left. Raises ScriptError."""
        self.operators += 1
        if self.operators > MAX_OPERATORS:
            message = f"more than {MAX_OPERATORS} operators in one statement"
            raise ScriptError(message, operator.column)

    def atom(self) -> Expression:
        token = self.take()
        if token.kind == "number":
            assert not isinstance(token.value, str)
            return Number(token.value)
        if token.kind == "text":
            return String(str(token.value))
        if token.kind == "name":
            if token.text in ("true", "false"):
                return Boolean(token.text == "true")
            return Name(token.text)
        if token.kind == "operator" and token.text == "(":
            inner = self.expression()
            self.expect(")", f"to close the one in column {token.column}")
            return inner
        raise ScriptError(f"a value expected, found {token}", token.column)
