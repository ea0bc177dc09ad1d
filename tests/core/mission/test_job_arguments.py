"""Arguments of jobs: ordered texts of what is given, and values with names of what facts have."""

from __future__ import annotations

import enum
from typing import Any

import pytest

from mrbt_mesh.core.mission.job_arguments import (
    is_exact_number,
    named_arguments,
    ordered_arguments,
)
from mrbt_mesh.core.mission.mission import JobParameter, JobType

DELIVER = JobType(
    "deliver",
    (
        JobParameter("shelf", ("shelf_1", "shelf_2")),
        JobParameter("rack", ("7", "8.5")),
        JobParameter("boxes", (), -1, 4),
    ),
)
TEXTS = ["shelf_1", "7", "3"]


class Shelf(str, enum.Enum):  # noqa: UP042 - users' enums, whose str() is no value
    ONE = "shelf_1"


@pytest.mark.parametrize(
    "given",
    [
        TEXTS,
        ("shelf_1", 7, 3),
        [Shelf.ONE, 7.0, 3.0],
        {"boxes": 3, "shelf": "shelf_1", "rack": "7"},
    ],
)
def test_a_number_and_its_text_are_the_same_in_order_and_by_name(given: Any) -> None:
    assert ordered_arguments(DELIVER, given) == TEXTS


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ([], "deliver takes 3 arguments (shelf, rack, boxes); given: 0"),
        ([*TEXTS, "x"], "deliver takes 3 arguments (shelf, rack, boxes); given: 4"),
        ({}, "deliver takes the arguments shelf, rack, boxes; given: none"),
        (
            {"shelf": "shelf_1", "rack": 7, "box": 3, 4: 5},
            "deliver takes the arguments shelf, rack, boxes; given: shelf, rack, box, 4",
        ),
        ("abc", "arguments are values in order, or by the names of parameters"),
        (3, "arguments are values in order, or by the names of parameters"),
        (
            ["shelf_1", 8.5, 3],
            "rack is one of 7, 8.5; 8.5 is neither a text nor a whole number",
        ),
        *(
            (
                ["shelf_1", "7", value],
                f"boxes is a whole number from -1 to 4; {shown} is neither a text nor a whole "
                "number",
            )
            for value, shown in (
                (True, "true"),
                (2.5, "2.5"),
                (float("nan"), "nan"),
                (float("inf"), "inf"),
                (None, "null"),
                ([], "a list"),
                ({}, "an object"),
                (b"3", "a value of type bytes"),
            )
        ),
        *(
            (
                ["shelf_1", "7", value],
                "boxes: the number has too many digits; boxes is a whole number from -1 to 4",
            )
            for value in (1 << 53, -(10**5_000), 1e300)
        ),
    ],
)
def test_what_is_no_argument_is_refused_with_what_would_be_right(given: Any, said: str) -> None:
    with pytest.raises(ValueError) as error:  # noqa: PT011 - the whole text is compared
        ordered_arguments(DELIVER, given)
    assert str(error.value) == said


def test_numbers_are_those_of_ranges() -> None:
    types = {"deliver": DELIVER}
    assert named_arguments(types, "deliver", TEXTS) == {"shelf": "shelf_1", "rack": "7", "boxes": 3}
    assert named_arguments(types, "deliver", ["a", "b", "many"])["boxes"] == "many"
    assert named_arguments(types, "lift", ["3"]) == {"1": "3"}
    assert named_arguments(types, "deliver", ["3"]) == {"1": "3"}


@pytest.mark.parametrize(
    ("text", "is_one"),
    [("0", True), ("-7", True), (str((1 << 53) - 1), True), (str(1 << 53), False)]
    + [(text, False) for text in ("-0", "+1", "01", "1.0", "1e3", "", "²", "9" * 40)],
)
def test_which_texts_a_number_can_become(text: str, is_one: bool) -> None:
    assert is_exact_number(text) is is_one
