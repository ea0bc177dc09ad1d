"""Files that people name, read within limits."""

from __future__ import annotations

import pickle
from pathlib import Path

import pytest

from mrbt_mesh.errors import FileError, MissingExtraError, read_limited


def test_that_an_extra_is_missing_can_be_said_by_another_process() -> None:
    error = MissingExtraError.of("the simulator", "planner")
    assert str(pickle.loads(pickle.dumps(error))) == str(error)


def test_a_file_up_to_its_limit(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_bytes(b"12345")
    assert read_limited(path, 5) == b"12345"
    with pytest.raises(FileError, match="larger than the limit of 4 bytes"):
        read_limited(path, 4)


def test_what_is_no_file(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="there is no such file"):
        read_limited(tmp_path / "gone", 5)
    with pytest.raises(FileError, match="not a file"):
        read_limited(tmp_path, 5)
