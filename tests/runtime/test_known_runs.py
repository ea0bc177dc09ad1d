"""Which run a command means."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Mapping
from pathlib import Path

import pytest

from mrbt_mesh.errors import InputError
from mrbt_mesh.runtime import known_runs
from mrbt_mesh.runtime.known_runs import find_run, is_running, look_up_run, remember
from mrbt_mesh.runtime.launcher_lock import launched_from_here
from mrbt_mesh.runtime.run_dir import RunDir, RunDirError
from tests.support.run_dirs import a_run

Begin = Callable[..., RunDir]
HERE = {"R1": os.getpid()}
OVER = {"R1": 0}


@pytest.fixture
def begin(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Begin:
    """Makes the next run, which runs or is over."""
    monkeypatch.setenv("MRBT_STATE_DIR", str(tmp_path / "state"))
    made: list[RunDir] = []

    def begin(pids: Mapping[str, int], example: str = "explore") -> RunDir:
        made.append(a_run(tmp_path / f"run{len(made)}", pids, example))
        remember(made[-1])
        for entry, known in known_runs._entries():
            age_s = len(made) - [run_dir.path for run_dir in made].index(known.path)
            os.utime(entry, (1e9 - age_s, 1e9 - age_s))
        return made[-1]

    return begin


def path_of(named: str | None = None) -> Path:
    return find_run(None if named is None else Path(named)).path


def test_the_team_that_runs_is_meant_and_without_any_the_newest_run(begin: Begin) -> None:
    older = begin(HERE)
    newer = begin(OVER)
    assert path_of() == older.path
    (older.path / "R1.process").unlink()
    assert path_of() == newer.path
    with launched_from_here(older):
        assert is_running(older)
        assert path_of() == older.path, "its launcher starts the robots only now"


def test_of_several_that_run_one_must_be_named_by_folder_team_or_mission(begin: Begin) -> None:
    explore, couriers = begin(HERE), begin(HERE, "couriers")
    with pytest.raises(RunDirError) as refused:
        find_run(None)
    lines = str(refused.value).splitlines()
    assert lines[0] == "2 teams run here: name one with --run-dir TEAM"
    assert lines[1:] == [f"  {run.info().team}  {run.path}" for run in (couriers, explore)]
    for name in (str(explore.path), explore.info().team, "explore"):
        assert path_of(name) == explore.path
    begin(OVER)
    assert path_of("explore") == explore.path
    begin(HERE)
    with pytest.raises(RunDirError, match="2 teams run here: name one"):
        path_of("explore")


def test_a_name_that_nothing_has_is_refused_with_the_nearest(begin: Begin) -> None:
    with pytest.raises(RunDirError, match="no run is known here: start one with `mrbt up`"):
        find_run(None)
    begin(OVER)
    with pytest.raises(RunDirError, match=r"explor holds no run .* did you mean 'explore'\?"):
        path_of("explor")


def test_folders_that_are_deleted_or_damaged_hide_no_other_run(begin: Begin) -> None:
    good, damaged, deleted = begin(OVER), begin(OVER), begin(HERE)
    shutil.rmtree(deleted.path)
    (damaged.path / "run.json").write_text("{")
    assert [run.path for run in known_runs.known_runs()] == [damaged.path, good.path]
    assert known_runs.team_name(damaged) == "run1"
    assert path_of("explore") == good.path


def test_only_the_newest_runs_and_those_that_run_are_remembered(
    begin: Begin, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(known_runs, "MOST_KNOWN", 2)
    runs = [begin(HERE), begin(OVER), begin(OVER), begin(OVER)]
    kept = [run.path for run in known_runs.known_runs()]
    assert kept == [runs[number].path for number in (3, 2, 0)]


@pytest.mark.parametrize("is_named", [True, False])
def test_robots_are_not_commanded_through_a_folder_that_others_can_write(
    begin: Begin, is_named: bool
) -> None:
    """They could write the number of any process there, and `mrbt kill` would kill that."""
    run_dir = begin(HERE)
    run_dir.path.chmod(0o777)
    named = run_dir.path if is_named else None
    with pytest.raises(InputError, match="can be written by other users: `chmod go-w"):
        find_run(named)
    assert look_up_run(named).path == run_dir.path, "it may be read"


def test_robots_are_not_commanded_through_a_link(begin: Begin, tmp_path: Path) -> None:
    link = tmp_path / "link"
    link.symlink_to(begin(HERE).path)
    with pytest.raises(InputError, match="is a link: name the folder itself"):
        find_run(link)
