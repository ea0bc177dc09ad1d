"""Under which names a page is served."""

from __future__ import annotations

import socket

import pytest

from mrbt_mesh.views.web.server import names_of


@pytest.mark.parametrize("anywhere", ["0.0.0.0", "::"])
def test_a_page_for_everybody_is_reached_by_each_address_of_its_machine(anywhere: str) -> None:
    names = names_of(anywhere)
    assert {"127.0.0.1", socket.gethostname().lower()} <= names
    assert not any("%" in name for name in names)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as asked:
        asked.connect(("127.0.0.1", 9))  # nothing is sent
        assert asked.getsockname()[0] in names


def test_a_page_at_one_address_has_no_other_names() -> None:
    assert names_of("127.0.0.1") == set()
