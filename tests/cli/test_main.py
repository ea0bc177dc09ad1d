"""All commands: their help, what they load, and messages for wrong input."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import click
import pytest
from ruamel.yaml import YAML

from mrbt_mesh.cli.main import main
from tests.support.command import EXPLORE, REPAIR, done, mrbt, refused
from tests.support.paths import ROOT
from tests.support.reference_pages import FOLDER
from tests.support.run_dirs import a_run


def commands(group: click.Group = main, path: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    """The paths of all commands and groups."""
    context = click.Context(group)
    for name in group.list_commands(context):
        yield (*path, name)
        inner = group.get_command(context, name)
        assert inner is not None
        assert inner.name == name
        if isinstance(inner, click.Group):
            yield from commands(inner, (*path, name))


ALL = list(commands())


@pytest.mark.parametrize("path", ALL, ids=" ".join)
def test_every_command_has_help_with_an_example(path: tuple[str, ...]) -> None:
    output = done(mrbt(*path, "--help"))
    assert "example" in output.lower()
    assert f"mrbt {' '.join(path)}" in output


def test_without_a_command_the_list_of_commands_is_shown() -> None:
    problems = refused(mrbt())
    assert "Run a team" in problems
    assert "estimate" in problems


def test_the_list_of_commands_fits_one_screen_and_has_them_all() -> None:
    _, output, _ = mrbt("--help", COLUMNS="80")
    lines = output.splitlines()
    assert len(lines) <= 24
    assert max(map(len, lines)) <= 80
    assert {path[0] for path in ALL} <= set(output.split())


def test_the_page_of_commands_has_them_all() -> None:
    lines = (FOLDER / "commands.md").read_text(encoding="utf-8").splitlines()
    headings = {line.removeprefix("## mrbt ") for line in lines if line.startswith("## ")}
    assert {" ".join(path) for path in ALL} <= headings


def test_a_command_that_is_none_is_refused_with_the_nearest_one() -> None:
    assert "No such command 'simulate'." in refused(mrbt("simulate"))
    assert "Did you mean 'kill'?" in refused(mrbt("kil", "A1"))
    assert "Did you mean 'check'?" in refused(mrbt("tree", "chek"))


# -- what is loaded ---------------------------------------------------------------------------

LARGE = {"zenoh", "numpy", "ortools", "pydantic", "ruamel", "cryptography"}
# Runs a command and writes, however it ends, which packages it has imported.
SCRIPT = """
import atexit, os, sys
file, end = sys.argv.pop(1), os._exit
def tell(code=None):
    with open(file, "w") as stream:
        stream.write(" ".join({name.partition(".")[0] for name in sys.modules}))
    if code is not None:
        end(code)
atexit.register(tell)
os._exit = tell
from mrbt_mesh.cli.main import main
main()
"""


def loaded(tmp_path: Path, *arguments: str) -> tuple[int, set[str]]:
    """(exit status, packages imported) of a command in a process of its own."""
    file = tmp_path / "loaded"
    command = [sys.executable, "-c", SCRIPT, str(file), *arguments]
    variables = {**os.environ, "MRBT_STATE_DIR": str(tmp_path / "state")}
    done = subprocess.run(command, env=variables, capture_output=True, cwd=ROOT, check=False)
    return done.returncode, set(file.read_text().split())


def test_help_loads_nothing_large() -> None:
    """All in one process, one after the other, with the packages that each has added."""
    script = """
import sys
from click.testing import CliRunner
from mrbt_mesh.cli.main import main
known = set()
for words in sys.argv[1:]:
    assert CliRunner().invoke(main, [*words.split(), "--help"]).exit_code == 0, words
    packages = {name.partition(".")[0] for name in sys.modules}
    print(words, *sorted(packages - known), sep=",")
    known |= packages
"""
    command = [sys.executable, "-c", script, "", *map(" ".join, ALL)]
    done = subprocess.run(command, capture_output=True, text=True, check=True, cwd=ROOT)
    lines = [line.split(",") for line in done.stdout.splitlines()]
    assert [words for words, *_ in lines] == ["", *map(" ".join, ALL)]
    assert {words: LARGE & {*packages} for words, *packages in lines if LARGE & {*packages}} == {}


def test_the_version_is_told_without_loading_what_draws(tmp_path: Path) -> None:
    assert "rich" not in loaded(tmp_path, "--version")[1]


@pytest.mark.parametrize("command", ["kill", "freeze", "thaw"])
def test_a_signal_is_sent_without_loading_anything_large(tmp_path: Path, command: str) -> None:
    """A short mission may be over before a slow command has started."""
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as process:
        run_dir = a_run(tmp_path / "run", {"R1": process.pid}).path
        code, packages = loaded(tmp_path, command, "R1", "--run-dir", str(run_dir))
        process.kill()
    assert (code, packages & (LARGE | {"rich"})) == (0, set())


@pytest.mark.slow
@pytest.mark.parametrize(
    "arguments",
    [
        ["validate", EXPLORE],
        ["plan", EXPLORE],
        ["analyze", EXPLORE, "--json"],
        ["tree", "show", EXPLORE],
        ["tree", "check", "examples/lift/repair.xml"],
    ],
    ids=lambda arguments: " ".join(arguments[:2]),
)
def test_what_needs_no_network_does_not_load_it(tmp_path: Path, arguments: list[str]) -> None:
    code, packages = loaded(tmp_path, *arguments)
    assert (code, "zenoh" in packages) == (0, False)


@pytest.mark.parametrize("command", [["validate", EXPLORE], ["tree", "show", EXPLORE]])
def test_what_plans_nothing_loads_no_solver(tmp_path: Path, command: list[str]) -> None:
    code, packages = loaded(tmp_path, *command)
    assert (code, "ortools" in packages) == (0, False)


def test_the_status_of_a_run_that_is_over_needs_no_network_and_no_solver(tmp_path: Path) -> None:
    run_dir = a_run(tmp_path / "run", {}).path
    (run_dir / "summary.json").write_text('{"result": "success", "robots": {}}')
    code, packages = loaded(tmp_path, "status", "--json", "--run-dir", str(run_dir))
    assert (code, packages & (LARGE | {"rich"})) == (0, set())


def test_who_watches_a_team_loads_no_solver_before_a_plan_needs_one() -> None:
    """Reading a team's plan takes numbers, but mostly nothing has to be solved for it."""
    code = "import sys, mrbt_mesh.cli.commands.status; print('ortools' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "False\n"


# -- what is refused --------------------------------------------------------------------------


@pytest.mark.parametrize("command", [("plan",), ("sim", "run"), ("up",)], ids=" ".join)
def test_a_solver_that_cannot_be_used_is_refused(command: tuple[str, ...]) -> None:
    problems = refused(mrbt(*command, EXPLORE, "--solver", "cpsat"))
    assert "no solver 'cpsat'; did you mean 'cp_sat'?" in problems
    problems = refused(mrbt(*command, EXPLORE, "--solver", "tests_have_no_such.module:solve"))
    assert "put its folder on PYTHONPATH" in problems


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("up", REPAIR, "--robots", "A1,Z9"), "mission vehicle_repair has no robot 'Z9'"),
        (("up", REPAIR, "--robots", "A1,A1"), "a robot is named twice"),
        (("up", REPAIR, "--beat", "1"), "the detection time must be at least 3 beat periods"),
        (("up", REPAIR, "--beat", "nan"), "nan: a number of at most"),
        (("up", "nowhere.yaml"), "nowhere.yaml"),
        (("up", REPAIR, "--program", "nowhere.py"), "nowhere.py: there is no such file"),
        (("up", REPAIR, "--detach", "--json"), "--json: with --detach the run is not shown"),
        (("up", REPAIR, "--detach", "--timeout", "9"), "--timeout: with --detach"),
        (("up", REPAIR, "--continue"), "--continue needs the --run-dir"),
        (("up", REPAIR, "--no-record", "--record-beats"), "with --no-record nothing is recorded"),
        (("watch", "--mission", REPAIR, "--record-beats"), "--record-beats: of a recording: give"),
        (("kill", "A1"), "no run is known here: start one with `mrbt up`"),
        (("kill",), "Missing argument 'ROBOT'"),
        (("kill", "A1", "A2"), "Got unexpected extra argument (A2)"),
        (("kill", "A1", "--run-dir", "a", "--run-dir", "b"), "--run-dir is given 2 times"),
        (("join", "A1"), "no run is known here"),
        (("status",), "no run is known here"),
        (("decide", "x", "perhaps"), "'perhaps' is not one of 'done', 'failed', 'retry'"),
        (("analyze", REPAIR, "--limit", "0"), "0.0 is not in the range x>=0.1"),
        (("tree", "check", REPAIR, "--strict"), "--strict: for BehaviorTree.CPP files"),
        (("drill", "--list", "--json"), "--json: --list runs no drill"),
        (("drill",), "name a drill, or give --all"),
    ],
)
def test_bad_input_is_a_message_and_status_2(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: tuple[str, ...], message: str
) -> None:
    monkeypatch.setenv("MRBT_STATE_DIR", str(tmp_path))
    assert message in refused(mrbt(*arguments)).replace("\n", " ")


def test_the_readme_shows_the_example_as_it_is() -> None:
    shown = (ROOT / "README.md").read_text().partition("```yaml\n")[2].partition("```")[0]
    read = YAML(typ="safe").load
    assert read(shown) == read(Path(EXPLORE))


# -- how the process ends ---------------------------------------------------------------------

# Threads of Zenoh may call Python while the interpreter ends, which aborts the process.
SCRIPT_WITH_SESSION = """
import atexit, sys
from mrbt_mesh.cli.command import fail
from mrbt_mesh.cli.main import COMMANDS, LateGroup
atexit.register(print, "the interpreter ends")

def act():
    import zenoh
    END

LateGroup({}, {}, COMMANDS, name="mrbt", callback=act, invoke_without_command=True).main()
"""


@pytest.mark.parametrize(
    ("end", "code"),
    [
        ("fail('too few have it', 1)", 1),
        ("raise SystemExit(3)", 3),
        ("return", 0),
        ("raise ValueError('a bug')", 1),
        ("raise KeyboardInterrupt", 1),
    ],
)
def test_after_a_session_the_process_ends_without_the_interpreter(end: str, code: int) -> None:
    script = SCRIPT_WITH_SESSION.replace("END", end)
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout) == (code, ""), done.stderr
