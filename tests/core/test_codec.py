"""Dataclasses as plain data, and back."""

from __future__ import annotations

import enum
import json
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, NamedTuple

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.core.codec import IN_ORDER, KEY, Codec, DataError, StandIn, TypesByName


class Colour(enum.StrEnum):
    RED = "red"
    BLUE = "blue"


class Span(NamedTuple):
    low: int
    high: int | None


class Shape(ABC):
    """A base class that the codec knows the dataclasses of."""

    @abstractmethod
    def area(self) -> int:
        """Its area."""


@dataclass(frozen=True)
class Square(Shape):
    side: int

    def area(self) -> int:
        return self.side**2


@dataclass(frozen=True)
class Circle(Shape):
    radius: int = 1

    def __post_init__(self) -> None:
        if self.radius < 0:
            raise ValueError("a radius is not negative")

    def area(self) -> int:
        return 3 * self.radius**2


@dataclass(frozen=True, slots=True)
class Thing:
    name: str = field(metadata=KEY)
    weight: int = 0
    length: int = field(init=False, default=0)

    def __post_init__(self) -> None:
        object.__setattr__(self, "length", len(self.name))


@dataclass(frozen=True)
class Tree:
    label: str
    children: tuple[Tree, ...] = ()


@dataclass(frozen=True)
class Whole:
    """A field of each kind."""

    tree: Tree
    truth: bool = False
    value: bool | int | str | None = False
    colour: Colour = Colour.RED
    span: Span | None = None
    pairs: tuple[tuple[str, int], ...] = ()
    sides: Square | Circle | None = None
    shape: Shape | None = None
    things: Mapping[str, Thing] = field(default_factory=dict)
    ordered: Annotated[Mapping[str, Thing], IN_ORDER] = field(default_factory=dict)
    ways: Mapping[tuple[str, str], int] = field(default_factory=dict)
    more: Annotated[Mapping[str, Any], TypesByName({"a": int, "b": tuple[str, ...]}.get)] = field(
        default_factory=dict
    )
    path: frozenset[str] = frozenset()
    anything: Any = None


CODEC = Codec(
    {frozenset[str]: StandIn(tuple[str, ...], lambda names: tuple(sorted(names)), frozenset)},
    lambda base: [kind for kind in (Square, Circle) if issubclass(kind, base)],
)
LEAST = {"tree": {"label": "x"}}

texts = st.text(max_size=3)
numbers = st.integers(-3, 3)
things = st.lists(st.builds(Thing, texts, numbers), max_size=3).map(
    lambda found: {each.name: each for each in found}
)
wholes = st.builds(
    Whole,
    st.recursive(
        st.builds(Tree, texts), lambda below: st.builds(Tree, texts, st.tuples(below, below))
    ),
    st.booleans(),
    st.none() | st.booleans() | numbers | texts,
    st.sampled_from(Colour),
    st.none() | st.builds(Span, numbers, st.none() | numbers),
    st.lists(st.tuples(texts, numbers), max_size=3).map(tuple),
    st.none() | st.builds(Square, numbers) | st.builds(Circle, st.integers(0, 3)),
    st.none() | st.builds(Square, numbers) | st.builds(Circle, st.integers(0, 3)),
    things,
    things,
    st.dictionaries(st.tuples(texts, texts), numbers, max_size=3),
    st.fixed_dictionaries({}, optional={"a": numbers, "b": st.lists(texts).map(tuple)}),
    st.frozensets(texts, max_size=3),
    st.none() | st.lists(numbers),
)


def text_of(value: Whole) -> str:
    return json.dumps(CODEC.write(Whole, value))


@given(wholes)
def test_every_value_is_read_as_it_was_written(value: Whole) -> None:
    again = CODEC.read(Whole, json.loads(text_of(value)))
    assert again == value
    assert type(again.value) is type(value.value)
    assert list(again.ordered) == list(value.ordered)


@given(wholes)
def test_equal_values_give_equal_text_but_for_an_order_that_counts(value: Whole) -> None:
    turned = Whole(
        **{
            **vars(value),
            "things": dict(reversed(value.things.items())),
            "ways": dict(reversed(value.ways.items())),
            "more": dict(reversed(value.more.items())),
        }
    )
    assert text_of(turned) == text_of(value)


json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | texts,
    lambda below: st.lists(below, max_size=3) | st.dictionaries(texts, below, max_size=3),
    max_leaves=8,
)


@given(st.data(), wholes, json_values)
def test_damaged_data_are_refused_or_a_value_of_the_type(
    data: st.DataObject, value: Whole, damage: object
) -> None:
    """Put anything at any place."""
    place: Any = {"whole": json.loads(text_of(value))}
    whole, key = place, "whole"
    while isinstance(place[key], dict | list) and place[key] and data.draw(st.booleans()):
        place = place[key]
        is_object = isinstance(place, dict)
        key = data.draw(st.sampled_from(sorted(place) if is_object else range(len(place))))
    place[key] = damage
    try:
        found = CODEC.read(Whole, whole["whole"])
    except DataError:
        return
    assert CODEC.read(Whole, json.loads(text_of(found))) == found


def test_what_is_as_usual_is_left_out() -> None:
    assert CODEC.write(Whole, Whole(Tree("x"))) == LEAST
    zero = CODEC.write(Whole, Whole(Tree("x"), value=0))
    assert zero == {**LEAST, "value": 0}
    assert type(zero["value"]) is int


def test_keys_are_not_repeated_in_the_values() -> None:
    things = {"b": Thing("b", 2), "a": Thing("a")}
    found = CODEC.write(Whole, Whole(Tree("x"), things=things, ordered=things))
    assert found["things"] == {"a": {}, "b": {"weight": 2}}
    assert found["ordered"] == [{"name": "b", "weight": 2}, {"name": "a"}]


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        ([], "an object expected, not []"),
        ({}, "'tree' is missing"),
        ({"tree": {}}, "tree: 'label' is missing"),
        ({"tree": {"label": 3}}, "tree.label: a text expected, not 3"),
        (
            {"tree": {"label": "x", "children": [{"label": "y"}, None]}},
            "tree.children.1: an object expected, not None",
        ),
        ({**LEAST, "truth": 1}, "truth: true or false expected, not 1"),
        ({**LEAST, "value": 1.0}, "value: true or false or a whole number or a text or null ex"),
        ({**LEAST, "colour": "green"}, "colour: red or blue expected, not 'green'"),
        ({**LEAST, "colour": ["red"]}, "colour: red or blue expected"),
        ({**LEAST, "span": [1]}, "span: a list of 2 expected, not [1]"),
        ({**LEAST, "span": [True, None]}, "span.0: a whole number expected, not True"),
        ({**LEAST, "pairs": [["a", 1], ["b", 1.0]]}, "pairs.1.1: a whole number expected"),
        ({**LEAST, "pairs": {"a": 1}}, "pairs: a list expected"),
        ({**LEAST, "sides": {"Tree": {}}}, "sides: an object with Square or Circle expected"),
        ({**LEAST, "sides": {}}, "sides: an object with Square or Circle expected"),
        ({**LEAST, "sides": 4}, "sides: an object with Square or Circle expected"),
        ({**LEAST, "shape": {"Square": {}, "Circle": {}}}, "shape: an object with Square or"),
        ({**LEAST, "shape": {"Square": {"side": "1"}}}, "shape.Square.side: a whole number"),
        ({**LEAST, "shape": {"Circle": {"radius": -1}}}, "shape.Circle: a radius is not negative"),
        ({**LEAST, "things": {"a": {"name": "a"}}}, "things.a: name is given twice"),
        (
            {**LEAST, "things": {"a": {"length": 1}}},
            "things.a.length: nothing of this name (only name, weight) expected",
        ),
        ({**LEAST, "ordered": [{"name": "a"}, {"name": "a"}]}, "ordered: a key is given twice"),
        ({**LEAST, "ways": [[["a", "b"], 1], [["a", "b"], 1]]}, "ways: a key is given twice"),
        ({**LEAST, "more": {"c": 1}}, "more.c: nothing of this name expected"),
        ({**LEAST, "more": {"a": "1"}}, "more.a: a whole number expected, not '1'"),
        ({**LEAST, "path": "abc"}, "path: a list expected"),
        (
            {**LEAST, "colours": 1},
            "colours: nothing of this name (only tree, truth, value, colour, ",
        ),
    ],
)
def test_what_is_wrong_is_told_with_its_path(damage: object, message: str) -> None:
    with pytest.raises(DataError) as caught:
        CODEC.read(Whole, damage)
    assert str(caught.value).startswith(message)


def test_a_text_may_stand_in_for_a_number() -> None:
    codec = Codec({int: StandIn(str, str, int)})
    assert codec.write(Thing, Thing("a", 2)) == {"name": "a", "weight": "2"}
    assert codec.read(Thing, {"name": "a", "weight": "2"}) == Thing("a", 2)
    with pytest.raises(DataError, match="weight: a text expected, not 2"):
        codec.read(Thing, {"name": "a", "weight": 2})


def test_messages_are_short_whatever_was_given() -> None:
    with pytest.raises(DataError) as caught:
        CODEC.read(Whole, {**LEAST, "things": {"x" * 1_000: "y" * 1_000}})
    assert len(str(caught.value)) < 300


def test_what_is_nested_too_deep_is_refused() -> None:
    data: dict[str, Any] = {"label": "x"}
    for _ in range(100_000):
        data = {"label": "x", "children": [data]}
    with pytest.raises(DataError, match="nested too deep"):
        CODEC.read(Tree, data)


@pytest.mark.parametrize("hint", [list[int], dict[str, int], list, float, "Tree"])
def test_types_without_a_form_are_refused(hint: Any) -> None:
    with pytest.raises(TypeError, match="has no form"):
        CODEC.write(hint, None)
