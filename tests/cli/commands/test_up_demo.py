"""`mrbt demo` and `mrbt new --example` without running anything: what is said of bad input."""

from __future__ import annotations

from pathlib import Path

from mrbt_mesh.formats.mission_file import load_mission
from mrbt_mesh.formats.shipped import examples
from tests.support.command import done, mrbt, refused


def test_help_lists_the_examples() -> None:
    for command in ("demo", "new"):
        _, output, _ = mrbt(command, "--help")
        said = " ".join(output.replace("│", " ").split())
        assert f"{', '.join(examples())}." in said


def test_an_unknown_example_is_refused(tmp_path: Path) -> None:
    for command in (("demo", "courier"), ("new", str(tmp_path / "x"), "--example", "courier")):
        assert "there is no example 'courier'; did you mean 'couriers'?" in refused(mrbt(*command))
    assert not list(tmp_path.iterdir())


def test_a_copy_of_an_example(tmp_path: Path) -> None:
    folder = tmp_path / "town"
    output = done(mrbt("new", str(folder), "--example", "couriers"))
    written = [line.removeprefix("wrote ") for line in output.splitlines() if "wrote" in line]
    assert written == [
        str(folder / name) for name in ("mission.yaml", "couriers.py", "simulated.py")
    ]
    assert load_mission(folder / "mission.yaml").program == str(folder.resolve() / "couriers.py")
