"""A Docker engine of the tests' own, a base image and wheels, where no registry can be reached.

What costs minutes is kept in a cache folder: the engine's images and the downloaded wheels. The
engine touches neither the host's firewall nor another engine, and is ended after the tests.
"""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

from tests.support.paths import ROOT

PACKAGES = ("docker.io", "docker-compose", "debootstrap")
MIRROR = "http://deb.debian.org/debian"
# The Debian release whose Python is this one, so that pip gets the wheels that it needs.
RELEASES = {(3, 11): "bookworm", (3, 13): "trixie"}
INCLUDED = "python3,python3-venv"
# What packages leave behind, and a robot has no use for.
DROPPED = ("var/cache/apt", "var/lib/apt/lists", "usr/share/doc", "usr/share/locale")
START_TIMEOUT_S = 60


class NoEngineError(Exception):
    """No Docker engine can be had here; the message says why."""


def cache_dir() -> Path:
    """$MRBT_CACHE_DIR, else the XDG cache folder."""
    given = os.environ.get("MRBT_CACHE_DIR")
    if given:
        return Path(given)
    base = os.environ.get("XDG_CACHE_HOME")
    return (Path(base) if base else Path.home() / ".cache") / "mrbt"


def run(
    command: Sequence[str], environment: Mapping[str, str] | None = None, timeout_s: float = 600
) -> str:
    """Run to the end; raises NoEngineError with what it said last."""
    try:
        done = subprocess.run(
            command,
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            timeout=timeout_s,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise NoEngineError(f"{command[0]}: {error}") from error
    if done.returncode != 0:
        raise NoEngineError(f"{' '.join(command[:3])} failed: {done.stdout.strip()[-500:]}")
    return done.stdout


def compose_command() -> list[str]:
    """$MRBT_COMPOSE, else docker-compose, else Compose v2 as a plugin of docker."""
    given = os.environ.get("MRBT_COMPOSE")
    if given:
        return given.split()
    return ["docker-compose"] if shutil.which("docker-compose") else ["docker", "compose"]


def install(say: Callable[[str], None]) -> None:
    """Install what is missing of Debian's packages."""
    if sys.platform != "linux" or os.geteuid() != 0:
        raise NoEngineError("starting an engine and making its base image needs root on Linux")
    if sys.version_info[:2] not in RELEASES:
        known = ", ".join(f"{major}.{minor}" for major, minor in RELEASES)
        raise NoEngineError(f"no Debian release has the Python of these tests ({known} do)")
    if all(shutil.which(command) for command in ("dockerd", "docker", "debootstrap")):
        with contextlib.suppress(NoEngineError):
            run([*compose_command(), "version"])
            return
    if not shutil.which("apt-get"):
        raise NoEngineError(f"{', '.join(PACKAGES)} are not installed, nor can they be by apt-get")
    say(f"installing {', '.join(PACKAGES)}")
    environment = os.environ | {"DEBIAN_FRONTEND": "noninteractive"}
    run(["apt-get", "update"], environment)
    # Another make target may be installing at the same time.
    wait = ("-o", "DPkg::Lock::Timeout=600")
    run(["apt-get", *wait, "install", "-y", "--no-install-recommends", *PACKAGES], environment)


@contextlib.contextmanager
def engine(say: Callable[[str], None]) -> Iterator[dict[str, str]]:
    """The environment in which `docker` and Compose reach an engine of our own."""
    data = cache_dir() / "docker"
    data.mkdir(parents=True, exist_ok=True)
    # Sockets need short paths.
    with (
        tempfile.TemporaryDirectory(prefix="mrbt-docker-", dir="/tmp") as folder,
        (cache_dir() / "docker.lock").open("w") as lock,
        (Path(folder) / "log").open("wb") as log,
    ):
        fcntl.flock(lock, fcntl.LOCK_EX)
        socket = f"unix://{folder}/socket"
        # An engine must not outlive tests that were killed: it would hold on to its data.
        command = ["setpriv", "--pdeathsig", "TERM"]
        command += ["dockerd", "--host", socket, "--data-root", str(data)]
        command += ["--exec-root", f"{folder}/exec", "--pidfile", f"{folder}/pid"]
        command += ["--bridge=none", "--iptables=false", "--ip-forward=false", "--ip-masq=false"]
        say("starting dockerd")
        process = subprocess.Popen(command, stdout=log, stderr=log, start_new_session=True)
        try:
            # Without a bridge of the engine's own, only the classic builder can run commands.
            environment = os.environ | {"DOCKER_HOST": socket, "DOCKER_BUILDKIT": "0"}
            _wait_until_it_answers(process, environment, Path(folder) / "log")
            yield environment
        finally:
            process.terminate()
            try:
                process.wait(timeout=START_TIMEOUT_S)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


def _wait_until_it_answers(
    process: subprocess.Popen[bytes], environment: Mapping[str, str], log: Path
) -> None:
    for _ in range(START_TIMEOUT_S * 5):
        with contextlib.suppress(NoEngineError):
            run(["docker", "version"], environment)
            return
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(timeout=0.2)
            break
    raise NoEngineError(f"dockerd does not run here: {log.read_text()[-800:]}")


def base_image(
    environment: Mapping[str, str], say: Callable[[str], None], included: str = INCLUDED
) -> str:
    """The name of an image of a small Debian with these packages; made once."""
    release = RELEASES[sys.version_info[:2]]
    recipe = hashlib.sha256(repr((release, included, DROPPED)).encode()).hexdigest()[:12]
    name = f"mrbt-base:{release}-{recipe}"
    with contextlib.suppress(NoEngineError):
        run(["docker", "image", "inspect", name], environment)
        return name
    say(f"making an image of Debian {release} with {included} (about a minute, once)")
    with _in_memory() as folder:
        root = folder / "root"
        command = ["debootstrap", "--variant=minbase", f"--include={included}", release]
        run([*command, str(root), MIRROR])
        for dropped in DROPPED:
            shutil.rmtree(root / dropped)
            (root / dropped).mkdir()
        archive = folder / "root.tar"
        run(["tar", "-C", str(root), "-cf", str(archive), "."])
        run(["docker", "import", str(archive), name], environment)
    return name


@contextlib.contextmanager
def _in_memory() -> Iterator[Path]:
    """A temporary folder where syncing, which dpkg does after each package, costs nothing."""
    with tempfile.TemporaryDirectory(prefix="base-", dir=cache_dir()) as folder:
        run(["mount", "-t", "tmpfs", "-o", "size=1g", "tmpfs", folder])
        try:
            yield Path(folder)
        finally:
            # A debootstrap that was ended leaves /proc mounted below it.
            run(["umount", "--recursive", folder])


def wheels(say: Callable[[str], None]) -> Path:
    """A folder with the wheels of requirements.lock; filled once per lock file and Python."""
    lock = ROOT / "requirements.lock"
    key = hashlib.sha256(lock.read_bytes() + repr(sys.version_info[:2]).encode()).hexdigest()[:12]
    folder = cache_dir() / f"wheels-{key}"
    if folder.exists():
        return folder
    say("downloading the wheels of requirements.lock")
    with tempfile.TemporaryDirectory(prefix="wheels-", dir=cache_dir()) as temporary:
        command = [sys.executable, "-m", "pip", "download", "--quiet", "--require-hashes"]
        run([*command, "--requirement", str(lock), "--dest", temporary])
        shutil.copytree(temporary, folder)
    return folder
