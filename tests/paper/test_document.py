"""docs/data/paper.md as committed, and its figures beside those of the paper."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from mrbt_mesh.core.mission.mission import Need
from paper.account import ROOT, load
from paper.document import DOCUMENT, PICTURES
from paper.tables import bounds, performances, tree_lines
from paper.tolerance import spares, survived

INF = "−∞"
# The paper's tables, under the mission's names of its tasks.
PERFORMANCES = [
    ("use_screwdriver", INF, INF, "1"),
    ("move_frame", INF, INF, "1"),
    ("do_diagnosis(k)", "3", "1", INF),
    ("replace_hw(k)", "1.5", "1", INF),
    ("replace_wires(k)", "1.5", "1", INF),
    ("use_soldering_iron(k)", INF, "1", INF),
]
BOUNDS = {
    ("remove_screws", "use_screwdriver", 1, 2),
    ("place_screws", "use_screwdriver", 1, 2),
    ("remove_cover", "move_frame", 2, 2),
    ("place_cover", "move_frame", 2, 2),
    ("diagnose_part(k)", "do_diagnosis(k)", 1, 1),
    ("fix_hw(k)", "replace_hw(k)", 1, 1),
    ("fix_wires(k)", "replace_wires(k)", 1, 2),
    ("solder(k)", "use_soldering_iron(k)", 1, 3),
}


@pytest.mark.slow
def test_the_committed_files_are_what_make_paper_writes() -> None:
    """In any process, whatever the order of its sets and dicts."""
    script = "from paper.document import files; import json; "
    script += "print(json.dumps({str(path): text for path, text in files().items()}))"
    environment = os.environ | {"PYTHONHASHSEED": "4711", "PYTHONIOENCODING": "utf-8"}
    told = subprocess.run(
        [sys.executable, "-c", script], cwd=ROOT, env=environment, capture_output=True, check=True
    )
    written = {Path(path): text for path, text in json.loads(told.stdout).items()}
    stale = [
        str(path)
        for path, text in written.items()
        if not (ROOT / path).is_file() or (ROOT / path).read_text(encoding="utf-8") != text
    ]
    assert stale == [], "run `python -m paper` and commit what it writes"
    pictures = {path for path in written if path != DOCUMENT}
    assert {path.relative_to(ROOT) for path in (ROOT / PICTURES).iterdir()} == pictures


def test_every_link_of_the_page_leads_somewhere() -> None:
    links = re.findall(r"\]\(([^)]+)\)", (ROOT / DOCUMENT).read_text(encoding="utf-8"))
    assert len(links) == 8
    for link in links:
        assert (ROOT / DOCUMENT.parent / link.partition("#")[0]).exists(), link


def test_the_tables_are_the_papers() -> None:
    mission = load()
    assert performances(mission) == PERFORMANCES
    found = bounds(mission)
    assert len(found) == len(BOUNDS)
    assert set(found) == BOUNDS


def test_a_part_with_bounds_of_its_own_gets_a_line_of_its_own() -> None:
    mission = load()
    odd = replace(mission.global_tasks["solder(3)"], needs=(Need("use_soldering_iron(3)", 1, 2),))
    changed = replace(mission, global_tasks={**mission.global_tasks, "solder(3)": odd})
    assert set(bounds(changed)) - BOUNDS == {("solder(k)", "use_soldering_iron(k)", 1, 2)}


def test_the_tree_shows_what_is_the_same_for_all_parts_once() -> None:
    lines = tree_lines(load())
    assert lines[:2] == ["Fallback", "├─ nominal?"]
    assert sum("k = 1 … 5" in line for line in lines) == 2
    leaves = [line.lstrip("├└─│ ") for line in lines]
    repair = leaves.index("fix_hw(k)")
    assert leaves[repair : repair + 3] == ["fix_hw(k)", "fix_wires(k)", "solder(k)"]
    assert leaves[-2:] == ["place_cover", "place_screws"]


def test_the_figures_on_faults_are_the_papers() -> None:
    mission = load()
    to_spare = {s.local_task: s.count for s in spares(mission)}
    assert to_spare == {
        "use_screwdriver": 1,
        "move_frame": 0,
        "do_diagnosis": 3,
        "replace_hw": 3,
        "replace_wires": 3,
        "use_soldering_iron": 1,
    }
    found = survived(mission)
    assert found.minor == sum(to_spare.values()) == 11
    assert found.majors == (("A1", "A2", "B1"), ("A1", "A2", "B2"))
    assert found.critical == ("C1", "C2", ("C1", "move_frame"), ("C2", "move_frame"))
    assert "add up to 10" in (ROOT / DOCUMENT).read_text(encoding="utf-8").replace("\n", " ")


def test_a_team_that_cannot_do_the_mission_survives_nothing() -> None:
    mission = load()
    few = {name: robot for name, robot in mission.robots.items() if name != "C1"}
    with pytest.raises(ValueError, match="even without a fault"):
        survived(replace(mission, robots=few))


def test_counting_is_refused_where_it_is_not_enough() -> None:
    mission = load()
    both = (Need("move_frame", 1, 1), Need("use_screwdriver", 1, 1))
    changed = replace(mission.global_tasks["place_cover"], needs=both)
    tasks = {**mission.global_tasks, "place_cover": changed}
    with pytest.raises(ValueError, match="place_cover needs several local tasks"):
        spares(replace(mission, global_tasks=tasks))
