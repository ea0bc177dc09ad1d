"""The reference pages are what commands and docstrings say."""

from __future__ import annotations

import pytest

from tests.support.reference_pages import FOLDER, PAGES


@pytest.mark.parametrize("name", PAGES)
def test_a_page_is_up_to_date(name: str) -> None:
    there = (FOLDER / name).read_text(encoding="utf-8")
    assert there == PAGES[name](), "write it anew: `make reference`"
