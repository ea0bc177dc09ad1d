"""What a robot said last that a launcher has started."""

from __future__ import annotations

from pathlib import Path

from mrbt_mesh.formats.mission_file import load_mission
from mrbt_mesh.runtime.team import Team
from tests.support.paths import mission_file
from tests.support.run_dirs import a_run


def test_what_it_printed_in_earlier_lives_is_not_its_last_word(tmp_path: Path) -> None:
    run_dir = a_run(tmp_path / "run", {})
    team = Team(run_dir, run_dir.info(), load_mission(mission_file("explore")))
    path = run_dir.output_path("R1")
    silent = f"R1 ended with status 2 and could not write why to {path}: is its disk full?"
    assert team.last_word("R1", 2) == silent
    path.write_text("before\n")
    assert team.last_word("R1", 2) == "before"
    team._printed_before["R1"] = path.stat().st_size
    assert team.last_word("R1", 2) == silent
    path.write_text("before\nat last: \udce4\n", errors="surrogateescape")
    assert team.last_word("R1", 2) == "at last: \ufffd"
    path.write_text("anew\n")
    assert team.last_word("R1", 2) == "anew"
