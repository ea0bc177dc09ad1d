"""Where runs are kept by default."""

from __future__ import annotations

from pathlib import Path

import pytest

from mrbt_mesh.errors import InputError
from mrbt_mesh.runtime.run_dir import state_dir


@pytest.fixture(autouse=True)
def nothing_given(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("MRBT_STATE_DIR", "XDG_STATE_HOME"):
        monkeypatch.delenv(name, raising=False)


def test_variables_come_before_the_home_folder(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", "/home/one")
    assert state_dir() == Path("/home/one/.local/state/mrbt")
    monkeypatch.setenv("XDG_STATE_HOME", "/state")
    assert state_dir() == Path("/state/mrbt")
    monkeypatch.setenv("MRBT_STATE_DIR", "/runs")
    assert state_dir() == Path("/runs")


def test_a_user_without_a_home_folder_is_told_what_to_set(monkeypatch: pytest.MonkeyPatch) -> None:
    def home() -> Path:
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.setattr(Path, "home", home)
    with pytest.raises(InputError, match=r"no home folder; set MRBT_STATE_DIR=DIR, or HOME"):
        state_dir()
