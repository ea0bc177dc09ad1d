"""The times of deaths in a run directory, for other observers."""

from __future__ import annotations

from pathlib import Path

import pytest

from mrbt_mesh.core.facts.records import Claim, Phase
from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.observer.episodes import MajorFault
from mrbt_mesh.runtime.run_dir import RunDir

NOW_US = 50_000_000
CLAIM = Claim("act", "repair", "weld", Phase.RUNNING, 1, "")
LIFE = Incarnation(1, "n")


def fault(exact: bool) -> MajorFault:
    return MajorFault(*("A", LIFE, 40_000_000, CLAIM, 40_100_000, 40_200_000, "B"), exact=exact)


def test_another_observer_reads_what_was_written(tmp_path: Path) -> None:
    run_dir = RunDir(tmp_path)
    assert run_dir.deaths(NOW_US) == []
    run_dir.write_deaths([fault(exact=True)], NOW_US)
    ((robot, incarnation, times),) = run_dir.deaths(NOW_US)
    assert (robot, incarnation, times.replacement, times.exact) == ("A", LIFE, "B", True)
    assert times.at_us == pytest.approx(40_000_000, abs=100_000)
    assert (times.detected_us or 0) - times.at_us == 100_000
    (tmp_path / "deaths.json").write_text('{"deaths": [')
    assert run_dir.deaths(NOW_US) == [], "damaged"


def test_a_step_of_the_wall_clock_moves_no_death(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run_dir = RunDir(tmp_path)
    run_dir.write_deaths([fault(exact=True)], NOW_US)
    monkeypatch.setattr("mrbt_mesh.runtime.run_dir.time.time", lambda: 0.0)
    ((_, _, times),) = run_dir.deaths(NOW_US + 5_000_000)
    assert times.at_us == pytest.approx(40_000_000, abs=100_000)
