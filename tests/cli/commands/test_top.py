"""`mrbt top`: what cannot be is said before anything is drawn."""

from __future__ import annotations

import pytest

from mrbt_mesh.cli.team import terminal_options
from mrbt_mesh.errors import InputError
from tests.support.command import REPAIR, mrbt


def test_without_the_extra_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(terminal_options, "NEEDED", ("no_such_module",))
    with pytest.raises(InputError, match=r"pip install 'mrbt-mesh\[top\]'"):
        terminal_options.check()


def test_without_a_terminal_it_names_what_needs_none() -> None:
    code, _, problem = mrbt("top", "--mission", REPAIR)
    assert code == 2
    assert "mrbt watch --headless" in problem
    assert "Traceback" not in problem
