"""The installed product where it is not at home: other Pythons, libraries, locales, users, folders.

`make test-environments`. What cannot be had on this machine is skipped with the reason.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import stat
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import pytest

from tests.support.paths import ROOT
from tests.support.wheel import build_wheel

pytestmark = [pytest.mark.processes, pytest.mark.timeout(900)]

TOUR = ROOT / "tests" / "support" / "tour.py"
RUNTIME, EVERYTHING = ROOT / "requirements.lock", ROOT / "requirements-dev.lock"
# What a robot installs besides the project itself: distributions, and MB (10^6 bytes) without
# bytecode. These may only fall. eclipse-zenoh has 34 MB of them, cryptography with its own 16.
MAX_DISTRIBUTIONS, MAX_MB = 16, 62.0
WEIGH = """
import importlib.metadata, json, os
found = {}
for each in importlib.metadata.distributions():
    files = [each.locate_file(f) for f in each.files or () if f.suffix != ".pyc"]
    found[each.metadata["Name"].lower()] = sum(os.stat(f).st_size for f in files if f.exists())
print(json.dumps(found))
"""
# Libraries of extras that commands of a robot do without.
OF_EXTRAS = {"matplotlib", "numpy", "ortools", "pandas", "rich", "starlette", "textual"}
# What pytest needs here; in the versions of the lock file.
TOOLS = ("hypothesis", "pytest", "pytest-asyncio", "pytest-timeout")
FAST = (
    "tests/core/facts",
    "tests/formats/test_mission_file.py",
    "tests/runtime/test_program_loader.py",
    "tests/runtime/test_solver_loader.py",
    "tests/sim/test_run_determinism.py",
)
# The newest Python for which packages need not have wheels yet.
EARLY = "3.14"
# A user that no system has a name for.
NAMELESS = 54_321
LATIN_1 = "en_US.ISO-8859-1"
# These share an environment, which takes longer to make than they do.
IN_ONE = pytest.mark.xdist_group("at home")
AS_ROBOT = pytest.mark.xdist_group("robot")


def version(python: str) -> str:
    """`3.11.2`; nothing if it is no Python that runs."""
    command = [python, "-c", "import sys; print('.'.join(map(str, sys.version_info[:3])))"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    except OSError:
        return ""
    return done.stdout.strip() if done.returncode == 0 else ""


def pythons() -> Iterator[str]:
    """Pythons of this machine: on PATH, Debian's, pyenv's."""
    for minor in (11, 12, 13, 14):
        if found := shutil.which(f"python3.{minor}"):
            yield found
    yield "/usr/bin/python3"
    yield sys.executable
    pyenv = Path(os.environ.get("PYENV_ROOT") or "~/.pyenv").expanduser()
    yield from map(str, sorted(pyenv.glob("versions/*/bin/python3")))


def python_of(wanted: str) -> str:
    """A Python of a version such as `3.12` or `3.11.2`; skips the test if there is none."""
    for python in pythons():
        if f"{version(python)}.".startswith(f"{wanted}."):
            return python
    pytest.skip(f"no Python {wanted} on this machine (PATH, /usr/bin, pyenv)")


class Installed:
    """The wheel and all that is locked, in an environment of its own that every user may read."""

    def __init__(self, folder: Path, python: str, wheel: Path, packages: Sequence[str]) -> None:
        self.folder, self.bin = folder, folder / "venv" / "bin"
        make = {"PYTHON": python}
        run(["sh", str(ROOT / "deploy" / "make-venv"), str(folder / "venv")], os.environ | make)
        self.pip("--require-hashes", "-r", str(RUNTIME))
        self.pip("--no-deps", str(wheel))
        names = "|".join(TOOLS)
        lock = EVERYTHING.read_text(encoding="utf-8")
        tools = re.findall(rf"^((?:{names})==[^ ;]+)", lock, re.MULTILINE)
        assert len(tools) == len(TOOLS)
        self.pip(*tools, *packages)

    def pip(self, *arguments: str) -> None:
        options = ("--quiet", "--disable-pip-version-check", "--no-compile")
        run([str(self.bin / "python"), "-m", "pip", "install", *options, *arguments])

    def tour(
        self, folder: Path, variables: Mapping[str, str], user: int | None = None, *more: str
    ) -> str:
        """Have a user go through the product; returns what the tour prints."""
        kept = {"PATH": os.environ["PATH"], "PYTHONDONTWRITEBYTECODE": "1"}
        state = {"MRBT_STATE_DIR": str(folder / "state")}
        command = [str(self.bin / "python"), str(self.folder / TOUR.name)]
        shutil.copy(TOUR, self.folder)
        command += [str(self.bin / "mrbt"), str(folder), *more]
        return run(command, kept | state | variables, folder, user)

    def tests(self) -> None:
        """A handful of fast tests."""
        command = [str(self.bin / "python"), "-m", "pytest", "-p", "no:cacheprovider", *FAST]
        run(command, os.environ | {"MRBT_TESTS": "quick", "PYTHONDONTWRITEBYTECODE": "1"}, ROOT)


class Robot(Installed):
    """The wheel without extras, in the versions of the lock file."""

    def __init__(self, folder: Path, python: str, wheel: Path) -> None:
        self.folder, self.bin = folder, folder / "venv" / "bin"
        make = {"PYTHON": python}
        run(["sh", str(ROOT / "deploy" / "make-venv"), str(folder / "venv")], os.environ | make)
        lines = re.findall(r"^(\S+==[^\\\n]+)", RUNTIME.read_text(encoding="utf-8"), re.MULTILINE)
        constraints = folder / "constraints.txt"
        constraints.write_text("\n".join(lines), encoding="utf-8")
        self.pip("-c", str(constraints), str(wheel))

    def weights(self) -> dict[str, int]:
        """The bytes of each distribution that a robot brings besides the project."""
        found: dict[str, int] = json.loads(run([str(self.bin / "python"), "-c", WEIGH]))
        own = ("pip", "setuptools", "mrbt-mesh")
        return {name: size for name, size in found.items() if name not in own}


def run(
    command: Sequence[str],
    environment: Mapping[str, str] = os.environ,
    folder: Path | None = None,
    user: int | None = None,
    status: int = 0,
) -> str:
    """What a command prints, which ends with this status."""
    alone = {} if user is None else {"user": user, "group": user, "extra_groups": []}
    done = subprocess.run(
        command,
        env=environment,
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        timeout=600,
        check=False,
        **alone,  # type: ignore[call-overload]
    )
    said = str(done.stdout.decode(errors="replace"))
    assert done.returncode == status, f"{command}\n{said[-5000:]}"
    return said


@pytest.fixture(scope="session")
def folder() -> Iterator[Path]:
    """A folder that every user may read: pytest's own are for one user alone."""
    with tempfile.TemporaryDirectory(prefix="mrbt-environments-") as name:
        Path(name).chmod(0o755)
        yield Path(name)


@pytest.fixture(scope="session")
def wheel(folder: Path) -> Path:
    (folder / "dist").mkdir()
    return build_wheel(folder / "dist")


def empty(folder: Path, name: str) -> Path:
    (folder / name).mkdir()
    return folder / name


TOURED = ("taken over", "gone on from its journals", "nothing", "succeeds in the simulator")


def check(said: str) -> None:
    assert all(each in said for each in TOURED), said


@pytest.mark.parametrize("wanted", ["3.11.2", "3.12", "3.13", EARLY])
def test_pythons(folder: Path, wheel: Path, wanted: str) -> None:
    python = python_of(wanted)
    try:
        installed = Installed(empty(folder, wanted), python, wheel, ())
    except AssertionError as error:
        if wanted == EARLY and "No matching distribution" in str(error):
            pytest.skip(f"a package of requirements.lock has no wheel for Python {wanted}: {error}")
        raise
    check(installed.tour(empty(installed.folder, "tour"), {"HOME": str(installed.folder)}))
    installed.tests()


@pytest.fixture(scope="session")
def robot(folder: Path, wheel: Path) -> Robot:
    return Robot(empty(folder, "robot"), sys.executable, wheel)


@AS_ROBOT
def test_a_robot_installs_little(robot: Robot) -> None:
    found = robot.weights()
    assert not OF_EXTRAS & found.keys()
    assert len(found) <= MAX_DISTRIBUTIONS, found
    assert sum(found.values()) / 1e6 <= MAX_MB, found


@AS_ROBOT
def test_a_plain_mission_runs_with_what_a_robot_installs(robot: Robot) -> None:
    home = {"HOME": str(robot.folder)}
    said = robot.tour(empty(robot.folder, "tour"), home, None, "robot")
    assert all(each in said for each in (*TOURED[:3], "what a robot has not is said")), said


@AS_ROBOT
@pytest.mark.parametrize(
    ("words", "extra"),
    [
        ("agent --mission MISSION --robot C1 --insecure --alone", "planner"),
        ("up MISSION --headless", "planner"),
        ("plan MISSION", "planner"),
        ("validate MISSION", "planner"),
        ("analyze MISSION", "planner"),
        ("sim run MISSION", "planner"),
        ("watch --top", "terminal"),
        ("serve", "web"),
        ("watch --web", "web"),
    ],
)
def test_what_a_robot_lacks_is_said_with_the_remedy(robot: Robot, words: str, extra: str) -> None:
    """A mission with jobs for whose assignments plain Python is too slow."""
    mission = ROOT / "examples" / "deliveries" / "mission.yaml"
    command = [str(mission) if word == "MISSION" else word for word in words.split()]
    variables = {"PATH": os.environ["PATH"], "MRBT_STATE_DIR": str(robot.folder / "state")}
    said = run([str(robot.bin / "mrbt"), *command], variables, robot.folder, status=2)
    # That messages are not signed is said as well.
    (problem,) = (line for line in said.splitlines() if "warning: not secure" not in line)
    assert problem.endswith(f"needs the extra '{extra}': pip install 'mrbt-mesh[{extra}]'")


def test_beside_other_libraries_of_asynchronous_programs(folder: Path, wheel: Path) -> None:
    """anyio and others look whether these can be imported, and then work in another way."""
    others = ("sniffio", "trio", "uvloop")
    installed = Installed(empty(folder, "libraries"), sys.executable, wheel, others)
    check(installed.tour(empty(installed.folder, "tour"), {"HOME": str(installed.folder)}))
    installed.tests()


@pytest.fixture(scope="session")
def at_home(folder: Path, wheel: Path) -> Installed:
    """In an environment that other users may run as well: Debian's Python, or this one."""
    readable = [each for each in ("/usr/bin/python3", sys.executable) if is_for_all(each)]
    python = next((each for each in readable if version(each) >= "3.11"), None)
    return Installed(empty(folder, "home"), python or sys.executable, wheel, ())


def is_for_all(python: str) -> bool:
    """Whether every user may run it."""
    path = Path(python).resolve()
    return path.exists() and all(
        each.stat().st_mode & (stat.S_IXOTH | stat.S_IROTH) for each in (path, *path.parents)
    )


@IN_ONE
def test_locale_c(at_home: Installed, folder: Path) -> None:
    # Without these Python would take UTF-8 all the same.
    plain = {"LC_ALL": "C", "PYTHONCOERCECLOCALE": "0", "PYTHONUTF8": "0"}
    check(at_home.tour(empty(folder, "locale-c"), {**plain, "HOME": str(folder)}))


@IN_ONE
def test_locale_latin_1(at_home: Installed, folder: Path) -> None:
    locales = empty(folder, "locales")
    compiled = ["localedef", "-i", "en_US", "-f", "ISO-8859-1", str(locales / LATIN_1)]
    try:
        run(compiled)
    except (OSError, AssertionError) as error:
        pytest.skip(f"no locale {LATIN_1} can be made (Debian: apt-get install locales): {error}")
    variables = {"LC_ALL": LATIN_1, "LOCPATH": str(locales), "PYTHONUTF8": "0"}
    shown = run(
        [str(at_home.bin / "python"), "-c", "import locale; print(locale.getpreferredencoding())"],
        os.environ | variables,
    )
    assert shown.strip().upper() == "ISO-8859-1"
    # A folder whose name this locale can show.
    place = empty(folder, "m\xfche")
    check(at_home.tour(place, {**variables, "HOME": str(folder)}))


def as_nameless(at_home: Installed) -> None:
    if os.geteuid() != 0:
        pytest.skip("only root can run a program as another user")
    if not is_for_all(str(at_home.bin / "python")):
        pytest.skip(f"other users may not run {sys.executable}, and there is no /usr/bin/python3")


@IN_ONE
def test_no_home_and_a_user_without_a_name(at_home: Installed, folder: Path) -> None:
    as_nameless(at_home)
    place = empty(folder, "nameless")
    os.chown(place, NAMELESS, NAMELESS)
    check(at_home.tour(place, {}, user=NAMELESS))
    command = [str(at_home.bin / "mrbt"), "ls"]
    said = run(command, {"PATH": os.environ["PATH"]}, place, NAMELESS, status=2)
    assert "set MRBT_STATE_DIR=DIR" in said
    assert "Traceback" not in said


@IN_ONE
def test_a_project_folder_that_cannot_be_written(at_home: Installed, folder: Path) -> None:
    as_nameless(at_home)
    place = empty(folder, "read-only")
    run([str(at_home.bin / "mrbt"), "new", str(place / "town"), "--example", "vehicle_repair"])
    os.chown(place, NAMELESS, NAMELESS)
    for path in (place / "town", *(place / "town").rglob("*")):
        path.chmod(0o555 if path.is_dir() else 0o444)
    before = sorted((place / "town").rglob("*"))
    check(at_home.tour(place, {"HOME": str(place), "PYTHONDONTWRITEBYTECODE": ""}, user=NAMELESS))
    assert sorted((place / "town").rglob("*")) == before
