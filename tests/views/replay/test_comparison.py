"""Two recorded runs compared, held against what `mrbt up` would have said of each."""

from __future__ import annotations

from pathlib import Path

import pytest

from mrbt_mesh.recording.folder import observer_file
from mrbt_mesh.recording.player import Player
from mrbt_mesh.recording.reader import read_recording
from mrbt_mesh.sim import Kill
from mrbt_mesh.views.replay.comparison import beside
from mrbt_mesh.views.replay.shown_recording import ShownRecording
from tests.support.recorded import record_example


@pytest.mark.slow
def test_figures_and_lanes_of_two_runs(tmp_path: Path) -> None:
    kills = [(9_000_000, Kill("B1")), (12_500_000, Kill("A1"))]
    results, shown = [], []
    for name, schedule in (("calm", []), ("killed", kills)):
        results.append(record_example(tmp_path / name, "vehicle_repair", 7, schedule))
        player = Player(read_recording(observer_file(tmp_path / name)))
        shown.append(ShownRecording(player, 0, 1.0))
    found = beside(*shown)
    assert found["files"] == ["calm/run.mcap", "killed/run.mcap"]
    rows = {row["figure"]: row for row in found["figures"]}
    time = rows["time of the mission"]
    calm_s, killed_s = (result.summary["duration_s"] for result in results)
    assert (time["first"], time["second"]) == pytest.approx((calm_s, killed_s), abs=0.05)
    assert time["difference"] == pytest.approx(time["second"] - time["first"])
    assert (rows["deaths"]["first"], rows["deaths"]["second"]) == (0, 2)
    longest = rows["replaced after, longest"]
    assert (longest["first"], longest["difference"]) == (None, None)
    taken = [fault["taken_over_ms"] for fault in found["lanes"]["fault"]]
    assert longest["second"] == max(taken) > 0
    assert found["first_death_s"] == [None, pytest.approx(9, abs=0.05)]
