"""A wheel is the whole product: installed far from a clone, it runs the demo and new teams."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import sysconfig
import venv
import zipfile
from collections import Counter
from email.parser import Parser
from pathlib import Path
from typing import Any

import pytest

from mrbt_mesh import __version__
from mrbt_mesh.drills.physical import spans
from tests.support.paper_run import check_order
from tests.support.paths import ROOT
from tests.support.wheel import WAIT_S, build_wheel


class Installed:
    """The wheel in an environment of its own; commands run in an empty folder.

    Of the project's environment it sees the dependencies, and not the project itself: that is
    there by a path file, which counts for that environment alone.
    """

    def __init__(self, folder: Path, wheel: Path) -> None:
        self.environment = folder / "environment"
        self.folder = folder / "empty"
        self.folder.mkdir()
        venv.create(self.environment, with_pip=False)
        (packages,) = self.environment.glob("lib/python*/site-packages")
        (packages / "dependencies.pth").write_text(sysconfig.get_path("purelib") + "\n")
        install = ["install", "--quiet", "--no-deps", "--no-index", str(wheel)]
        pip = [sys.executable, "-m", "pip", "--disable-pip-version-check"]
        subprocess.run([*pip, "--python", self.python, *install], check=True, timeout=WAIT_S)

    @property
    def python(self) -> str:
        return str(self.environment / "bin" / "python")

    def run(self, program: str, *arguments: str) -> str:
        """Run a program of the environment, which must succeed; returns what it printed."""
        variables = {name: os.environ[name] for name in ("PATH", "LANG") if name in os.environ}
        state = {"HOME": str(self.folder), "MRBT_STATE_DIR": str(self.folder / "state")}
        done = subprocess.run(
            [str(self.environment / "bin" / program), *arguments],
            cwd=self.folder,
            env=variables | state,
            capture_output=True,
            text=True,
            timeout=WAIT_S,
            check=False,
        )
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    def told(self, *arguments: str) -> dict[str, Any]:
        """What `mrbt ... --json` prints."""
        data: dict[str, Any] = json.loads(self.run("mrbt", *arguments, "--json"))
        return data


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build_wheel(tmp_path_factory.mktemp("dist"))


@pytest.fixture(scope="module")
def installed(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Installed:
    return Installed(tmp_path_factory.mktemp("installed"), wheel)


def test_it_holds_what_a_user_needs_and_nothing_else(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
        about = f"mrbt_mesh-{__version__}.dist-info"
        metadata = Parser().parsestr(archive.read(f"{about}/METADATA").decode())
        license_text = archive.read(f"{about}/licenses/LICENSE").decode()
    assert {name.split("/")[0] for name in names} == {"mrbt_mesh", about}
    assert "mrbt_mesh/py.typed" in names
    assert not [name for name in names if "__pycache__" in name or name.endswith(".pyc")]
    for folder in ("agents", "drills", "examples"):
        files = [path for path in (ROOT / folder).rglob("*") if path.suffix in (".py", ".yaml")]
        assert {f"mrbt_mesh/share/{path.relative_to(ROOT)}" for path in files} <= set(names)
    page = [path for path in (ROOT / "mrbt_mesh/views/web/static").rglob("*") if path.is_file()]
    assert {str(path.relative_to(ROOT)) for path in page} <= set(names)
    assert license_text == (ROOT / "LICENSE").read_text()
    assert metadata["License-Expression"] == "Apache-2.0"
    assert metadata["Description-Content-Type"] == "text/markdown"


def test_the_demo(installed: Installed) -> None:
    where = installed.run("python", "-c", "import mrbt_mesh; print(mrbt_mesh.__file__)")
    assert Path(where.strip()).is_relative_to(installed.environment)
    assert installed.run("mrbt", "--version").split() == ["mrbt-mesh", __version__]

    summary = installed.told("demo", "--speed", "10")
    assert summary["result"] == "success"
    run_dir = Path(summary["run_dir"])
    assert run_dir.is_relative_to(installed.folder)
    events = [json.loads(line) for line in (run_dir / "events.jsonl").read_text().splitlines()]
    check_order(spans(events))
    assert {event["robot"] for event in events} <= {"A1", "A2", "B1", "B2", "C1", "C2"}
    assert str(ROOT) not in (run_dir / "run.json").read_text()


def test_a_new_team(installed: Installed) -> None:
    installed.run("mrbt", "new", "my_team")
    summary = installed.told("up", "my_team/mission.yaml", "--speed", "10")
    assert summary["result"] == "success"
    lines = (Path(summary["run_dir"]) / "events.jsonl").read_text().splitlines()
    carried = Counter(
        event["args"][0]
        for event in map(json.loads, lines)
        if event["local_task"] == "carry" and event["outcome"] == "success"
    )
    assert carried.keys() == {"red", "green", "blue"}
    assert carried["green"] >= 2, "the heavy box takes two robots"


def test_a_copy_of_an_example(installed: Installed) -> None:
    installed.run("mrbt", "new", "town", "--example", "couriers")
    assert installed.told("sim", "run", "town/mission.yaml")["result"] == "success"


def test_the_drills(installed: Installed) -> None:
    assert "freeze_then_thaw" in installed.run("mrbt", "drill", "--list")
