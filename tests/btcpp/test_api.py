"""Trees without a team: `load`, `check` and `run`."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import anyio
import pytest

from mrbt_mesh import btcpp

TREE = (
    '<root BTCPP_format="4"><BehaviorTree ID="Main"><Sequence>'
    '<Drive to="{goal}"/><Script code="arrived := true"/>'
    "</Sequence></BehaviorTree></root>"
)
PROGRAM = """
from pathlib import Path
from mrbt_mesh.btcpp import Leaves, TaskFailedError
leaves = Leaves()

@leaves.action("Drive")
async def drive(to: str) -> None:
    if to == "wall":
        raise TaskFailedError("a wall")
    Path(__file__).with_name("went.txt").write_text(to)
"""


@pytest.fixture
def files(tmp_path: Path) -> Path:
    (tmp_path / "tree.xml").write_text(TREE)
    (tmp_path / "robot.py").write_text(PROGRAM)
    return tmp_path


def test_a_tree_is_run_with_the_leaves_of_a_program(files: Path) -> None:
    def status(goal: str) -> btcpp.NodeStatus:
        return btcpp.run(files / "tree.xml", files / "robot.py", entries={"goal": goal})

    assert status("dock") is btcpp.NodeStatus.SUCCESS
    assert (files / "went.txt").read_text() == "dock"
    assert status("wall") is btcpp.NodeStatus.FAILURE
    leaves = btcpp.load_leaves(str(files / "robot.py"))
    with pytest.raises(btcpp.FileError, match="no tree 'Other'"):
        btcpp.run(files / "tree.xml", leaves, tree="Other")


def test_a_tree_is_loaded_and_run_within_an_event_loop(files: Path) -> None:
    async def main() -> None:
        tree = btcpp.load(files / "tree.xml", leaves=btcpp.load_leaves(files / "robot.py"))
        tree.blackboard["goal"] = "dock"
        assert await tree.run() is btcpp.NodeStatus.SUCCESS
        assert tree.blackboard.get("arrived") == 1

    anyio.run(main)


def test_check_finds_errors_and_warnings(files: Path) -> None:
    file = files / "tree.xml"
    assert btcpp.check(file) == []
    (unknown,) = btcpp.check(file, is_strict=True)
    assert (unknown.severity, unknown.problem.path) == (btcpp.Severity.ERROR, "Main/Sequence/Drive")
    file.write_text(TREE.replace("<Drive", "<Delay").replace("to=", "delay_msec="))
    (childless,) = btcpp.check(file)
    assert "exactly 1 child" in str(childless)
    with pytest.raises(btcpp.FileError, match="no such file"):
        btcpp.check(files / "missing.xml")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x = 1", "exactly one Leaves"),
        ("from mrbt_mesh.btcpp import Leaves\na, b = Leaves(), Leaves()", "found 2"),
        ("1 +", "SyntaxError"),
        ("import no_such_module", "ModuleNotFoundError: No module named 'no_such_module'"),
    ],
)
def test_a_program_that_cannot_be_used(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "robot.py").write_text(text)
    with pytest.raises(btcpp.FileError, match=rf"robot\.py: .*{message}"):
        btcpp.load_leaves(tmp_path / "robot.py")


def test_a_program_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(btcpp.FileError, match="cannot be read: No such file"):
        btcpp.load_leaves(tmp_path / "robot.py")


def test_it_needs_anyio_and_the_standard_library_alone() -> None:
    code = "import sys, mrbt_mesh.btcpp; print(*{n.partition('.')[0] for n in sys.modules})"
    isolated = [sys.executable, "-S", "-c", f"import sys; sys.path[:0] = {sys.path!r}; {code}"]
    done = subprocess.run(isolated, capture_output=True, text=True, check=True)
    others = set(done.stdout.split()) - set(sys.stdlib_module_names)
    # anyio imports sniffio where it is installed.
    assert others - {"sniffio"} == {"__main__", "anyio", "mrbt_mesh"}
