"""What a watch does before there is anything to watch."""

from __future__ import annotations

import pytest

from mrbt_mesh.cli import watching


def test_it_waits_for_the_first_run_of_a_machine(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    seen = [["a run"], [], []]
    monkeypatch.setattr(watching, "LOOK_S", 0)
    monkeypatch.setattr(watching, "known_runs", lambda: seen.pop())
    watching.wait_for_a_run()
    assert seen == []
    assert capsys.readouterr().err.count("no run is known here: waiting for the first one") == 1
