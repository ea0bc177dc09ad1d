"""`mrbt drill` without running any: lists, and what is said of bad input."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.support.command import REPAIR, done, mrbt, refused


def drill(folder: Path, name: str = "d", more: str = "") -> Path:
    path = folder / f"{name}.yaml"
    path.write_text(f"name: {name}\nmission: {REPAIR}\ndescription: One. Two.\n{more}")
    return path


def test_list_counts_the_runs_of_each_drill(tmp_path: Path) -> None:
    drill(tmp_path, "one")
    drill(tmp_path, "many", "for_each: {r: [A1, B1]}\ntransport: [wired, wireless]\nquick: true\n")
    drill(tmp_path, "cut", "network: namespaces\n")
    output = done(mrbt("drill", "--list", str(tmp_path)))
    rows = [line.split() for line in output.splitlines()[1:]]
    assert rows == [
        ["cut", "1", "namespaces", "One"],
        ["many", "4", "quick", "One"],
        ["one", "1", "One"],
    ]
    _, output, _ = mrbt("drill", "--list", "--quick", str(tmp_path))
    assert [line.split()[0] for line in output.splitlines()[1:]] == ["many"]


def test_the_shipped_drills_are_listed_wherever_one_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    output = done(mrbt("drill", "--list"))
    assert "freeze_then_thaw" in output
    assert "partition_and_heal" in output


def test_bad_input_is_told_with_file_and_line(tmp_path: Path) -> None:
    path = drill(tmp_path, more="steps: [{at: 1, kil: R1}]\n")
    problems = refused(mrbt("drill", str(path)))
    assert f"{path}:4: steps[1]/kil: unknown key 'kil'; did you mean 'kill'?" in problems


def test_commands_that_do_not_say_what_to_run(tmp_path: Path) -> None:
    path = str(drill(tmp_path))
    empty = tmp_path / "empty"
    empty.mkdir()
    for arguments, message in (
        ((), "name a drill, or give --all"),
        (("--all", path), "not both"),
        (("none.yaml",), "there is no such file"),
        ((str(empty),), "the folder has no drill"),
        ((path, "--junit", str(empty / "a" / "b.xml")), "there is no folder"),
        ((path, "--repeat", "0"), "Invalid value for '--repeat'"),
    ):
        code, _, problems = mrbt("drill", *arguments)
        assert (code, message in problems) == (2, True), problems
