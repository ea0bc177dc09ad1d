"""`mrbt key`: a team's key, never overwritten."""

from __future__ import annotations

from pathlib import Path

from tests.support.command import mrbt


def test_a_key_is_made_once_and_never_overwritten(tmp_path: Path) -> None:
    path = tmp_path / "team.pem"
    code, output, _ = mrbt("key", str(path))
    assert (code, output.partition(";")[0]) == (0, f"wrote {path}")
    made = path.read_bytes()
    code, _, problems = mrbt("key", str(path))
    assert code == 2
    assert "exists already" in problems
    assert path.read_bytes() == made
    code, _, problems = mrbt("key", str(tmp_path / "nowhere" / "team.pem"))
    assert code == 2
    assert "cannot be written" in problems
