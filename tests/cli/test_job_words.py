"""Arguments of a job as words."""

from __future__ import annotations

import pytest

from mrbt_mesh.cli.job_words import arguments_in
from mrbt_mesh.errors import InputError


def test_words_are_in_order_or_by_name() -> None:
    assert arguments_in(()) == []
    assert arguments_in(("shelf_2", "3")) == ["shelf_2", "3"]
    assert arguments_in(("boxes=-3", "shelf=", "x=a=b")) == {"boxes": "-3", "shelf": "", "x": "a=b"}


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("dock_1", "shelf=a"), "'shelf=a' has a name and 'dock_1' has none: give all arguments"),
        (("a=1", "b=2", "a=3"), "'a' is given twice: '1' and '3'"),
    ],
)
def test_a_mixture_and_a_name_that_is_given_twice_are_refused(
    words: tuple[str, ...], said: str
) -> None:
    with pytest.raises(InputError) as error:
        arguments_in(words)
    assert said in str(error.value)
