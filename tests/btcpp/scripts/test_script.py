"""The scripting language: parsing, printing, evaluating, and errors with their columns."""

from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.btcpp.scripts import script as ast
from mrbt_mesh.btcpp.scripts.evaluator import is_true
from mrbt_mesh.btcpp.scripts.parser import MAX_NESTING, MAX_OPERATORS, dialect_problem, parse
from mrbt_mesh.btcpp.scripts.script import ScriptError
from tests.support.btcpp.boards import board_of, entries_of, evaluate


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1 + 2 * 3", 7),
        ("(1 + 2) * 3", 9),
        ("7 - 2 - 1", 4),
        ("1 / 4", 0.25),
        ("1 / 0", math.inf),
        ("-2 * -3", 6),
        ("0x1F", 31),
        ("1.5e2", 150),
        ("2e-1", 0.2),
        ("6 & 3", 2),
        ("6 | 3", 7),
        ("6 ^ 3", 5),
        ("~0", -1),
        ("!0", 1),
        ("!3", 0),
        ("true", 1),
        ("false", 0),
        ("1 && 0", 0),
        ("1 && 2.5", 1),
        ("0 || 0", 0),
        ("1 || 0 && 0", 1),  # `&&` binds tighter
        ("0 && 1 || 1", 1),
        ("1 || 1 && 0 || 0", 1),
        ("1 < 2 < 3", 1),
        ("1 < 3 < 2", 0),
        ("2 >= 2 <= 2 != 3 > 1", 1),
        ("'a' == \"a\"", 1),
        ("'a' < 'b'", 1),
        ("'2' == 2", 1),
        ("0.1 + 0.2 == 0.3", 1),
        ("'a' .. 'b'", "ab"),
        ("'a' .. 1", "a1"),
        ("1.5 .. 'a'", "1.500000a"),
        ("'a' + 'b'", "ab"),
        ("'x' .. (1 + 1)", "x2.000000"),
        ("1 ? 'yes' : 'no'", "yes"),
        ("'1x' ? 1 : 2", 1),
        ("'0' ? 1 : 2", 2),
        ("0 ? 1 : 1 + 1", 2),
        ("n", 5),
        ("@n", 7),
        ("n == RED", 0),
        ("word == RED", 1),
        ("(k := 2) + k", 4),
        ("a := 1; a += 4; a *= 3; a -= 1; a /= 2; a", 7),
        ("w := 'a'; w += 'b'", "ab"),
        ("n = '8'; n", 8),
        ("1 2", 2),  # ';' may be missing, or too much
        ("x := 1;", 1),
        ("x := 1;; ;x := 2;;", 2),
        ("1 ? 2 : 3 ? 4 : 5", 2),
        ("0 ? 2 : 0 ? 4 : 5", 5),
        ("k := m := 2; k + m", 4),
        ("1 + 2 & 3", 3),
        ("2 * 3 .. 'x'", "6.000000x"),
        ("~1 + 2", 0),
        ("1 .. 2", None),  # nothing, as in the library
        ("true .. 'x'", "1.000000x"),
        ("@n = 9; @n + n", 14),
        ("1 +\n 2", 3),
        ("1 + \\\n 2", 3),
        ("trueish := 4", 4),
        ("größe := 1", 1),
        ("'x ; y'", "x ; y"),
    ],
)
def test_values(text: str, value: Any) -> None:
    board = board_of({"n": 5, "word": "RED"}, parent=board_of({"n": 7}))
    result = evaluate(text, board, RED=3)
    assert result == pytest.approx(value) if isinstance(value, float) else result == value


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ('x := "a"', "in double quotes"),
        ("größe := 1", "the name 'größe', which is not ASCII"),
        ("x := 1 + \\\n 2", "between the parts"),
        ("x := 1\f", "between the parts"),
        ("x := 'größe \\ '; x := 0.000; y_1 = @z", ""),
    ],
)
def test_what_the_library_cannot_read(text: str, problem: str) -> None:
    assert parse(text)
    found = dialect_problem(text)
    assert problem in found if problem else not found


def test_assignment_changes_the_blackboard() -> None:
    board = board_of({"x": 1})
    evaluate("y := x + 1; x = 'z' == 'z'; @r := 3", board)
    assert entries_of(board) == {"x": 1, "y": 2.0, "r": 3}


@pytest.mark.parametrize(
    ("text", "column", "message"),
    [
        ("", 1, "a value expected, found the end of the script"),
        ("1 +", 4, "a value expected, found the end of the script"),
        (";", 1, "a value expected, found ';'"),
        ("1 )", 3, "a value expected, found ')'"),
        ("12abc", 3, "'a' cannot follow the number 12"),
        ("1.2.3", 4, "'.' cannot follow the number 1.2"),
        ("1.", 2, "'.' cannot follow the number 1"),
        ("0x1F..2", 5, "'.' cannot follow the number 0x1F"),
        ("0xg", 2, "'x' cannot follow the number 0"),
        ("'open", 1, "not closed"),
        ("a $ b", 3, "'$' has no meaning"),
        ("(1 + 2", 7, "')' expected to close the one in column 1"),
        ("1 ? n : 3 = 2", 11, "a value expected, found '='"),  # none after `a ? b : c`
        ("1 ? 2", 6, "':' expected between the two values"),
        ("99999999999999999999", 1, "too large"),
        ("9" * 5000, 1, "too large"),
        ("1e999", 1, "too large"),
        ("1e-999", 1, "too small"),
        ("(" * 100 + "1", MAX_NESTING + 1, "nested deeper than"),
        ("-" * 100 + "1", MAX_NESTING, "nested deeper than"),
        ("1" + "+1" * 300, 2 * MAX_OPERATORS + 2, "more than 200 operators"),
        ("1 " * 20_000, 0, "more than 20000 characters"),
    ],
)
def test_syntax_errors(text: str, column: int, message: str) -> None:
    with pytest.raises(ScriptError) as caught:
        parse(text)
    assert message in str(caught.value)
    assert caught.value.column == column


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("missing", "no blackboard entry 'missing'"),
        ("missing = 1", "':=' creates one"),
        ("missing += 1", "':=' creates one"),
        ("'a' - 'b'", "not possible"),
        ("'a' && 1", "not possible"),
        ("1 .. 2 == 1", "has no value"),
        ("k := 1 .. 2", "has no value"),
        ("1 = 2", "only a blackboard entry can stand before '='"),
        ("1 && 2", "neither true nor false"),
        ("1 && -1.5", "neither true nor false"),
        ("word = 1", "no blackboard entry"),
        ("w = 1", "cannot take the place"),
        ("n = 2.5", "is not an integer"),
        ("n = 'x'", "is not an integer"),
        ("t = 'x'", "neither true nor false"),
        ("-'a'", "needs a number"),
        ("1.5 & 1", "is not an integer"),
        ("~1e30", "out of the range"),
        ("'a' < 1", "is not a number"),
        ("w *= 'b'", "needs a number"),
        ("w -= 1", "which holds a text"),
    ],
)
def test_evaluation_errors(text: str, message: str) -> None:
    with pytest.raises(ScriptError, match=message):
        evaluate(text, board_of({"w": "text", "n": 3, "t": True}))


def test_truth() -> None:
    assert is_true(1)
    assert is_true(2.5)
    assert not is_true(0.0)
    with pytest.raises(ScriptError, match="neither true nor false"):
        is_true("yes")
    with pytest.raises(ScriptError, match="2 is neither true nor false"):
        is_true(2)


def test_side_effects_and_names() -> None:
    parsed = parse("a := b + 1; c += (d = 2); 'x' == e ? f : @g")
    assert parsed.written == {"a", "c", "d"}
    assert parsed.read == {"b", "c", "e", "f", "@g"}
    assert not parse("a == 1 && !b").written


NAMES = st.sampled_from(["a", "b_1", "@root", "_x", "größe", "truely"])
TEXTS = st.text(st.characters(blacklist_characters="'\"", blacklist_categories=["Cs"]), max_size=5)
NUMBERS = st.integers(0, 2**63 - 1) | st.floats(0, 1e300, allow_nan=False)
LEAVES = (
    NUMBERS.map(abs).map(ast.Number)
    | st.booleans().map(ast.Boolean)
    | TEXTS.map(ast.String)
    | NAMES.map(ast.Name)
)
BINARY = sorted(ast.BITS | ast.LOGICAL | {"+", "-", "*", "/", ".."})


def _comparison(parts: list[tuple[str, Any]], first: Any) -> ast.Comparison:
    return ast.Comparison(tuple(o for o, _ in parts), (first, *(e for _, e in parts)))


def _larger(inner: st.SearchStrategy[Any]) -> st.SearchStrategy[Any]:
    comparisons = st.lists(
        st.tuples(st.sampled_from(sorted(ast.COMPARISONS)), inner), min_size=1, max_size=3
    )
    return (
        st.builds(ast.Unary, st.sampled_from("-~!"), inner)
        | st.builds(ast.Binary, st.sampled_from(BINARY), inner, inner)
        | st.builds(_comparison, comparisons, inner)
        | st.builds(ast.Conditional, inner, inner, inner)
        | st.builds(ast.Assign, st.sampled_from(sorted(ast.ASSIGNMENTS)), NAMES, inner)
        | st.builds(
            ast.Impossible,
            inner.filter(lambda left: not isinstance(left, ast.Name)),
            st.sampled_from(sorted(ast.ASSIGNMENTS)),
            inner,
        )
    )


EXPRESSIONS = st.recursive(LEAVES, _larger, max_leaves=20)
SCRIPTS = st.lists(EXPRESSIONS, min_size=1, max_size=3).map(tuple).map(ast.Script)


@given(SCRIPTS)
def test_what_is_printed_parses_to_the_same(script: ast.Script) -> None:
    assert parse(str(script)) == script


@given(st.text(max_size=60) | st.text("ab1.0x'\";:=+-*/&|^~!?<>()@ \n", max_size=60))
def test_any_text_parses_or_says_why(text: str) -> None:
    try:
        parsed = parse(text)
    except ScriptError as error:
        column = error.column
    else:
        column = 0
        assert parse(str(parsed)) == parsed
    assert column <= len(text) + 1


@given(SCRIPTS)
def test_evaluation_ends_with_a_value_or_an_error(script: ast.Script) -> None:
    before = {"a": 1, "b_1": "x", "_x": 2.5}
    board = board_of(before)
    try:
        evaluate(script, board)
    except ScriptError:
        return
    except OverflowError:
        pytest.fail(f"overflow in {script}")
    if not script.written:
        assert entries_of(board) == before
