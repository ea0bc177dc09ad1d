"""The six-robot demo of docker-compose.yml, built and run for real."""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.support import docker_engine as docker
from tests.support.docker_compose import (
    BROKER_FILE,
    HOLD_FOLDER,
    NODE_FOLDER,
    OVERRIDE,
    PROJECT,
    Compose,
)
from tests.support.docker_engine import NoEngineError
from tests.support.paths import ROOT

CONTEXT = ("mrbt_mesh", "agents", "drills", "examples", "deploy", "pyproject.toml")
CONTEXT += ("requirements.lock", "README.md", "LICENSE", "docker-compose.yml", ".dockerignore")


@pytest.fixture(scope="session")
def say(request: pytest.FixtureRequest) -> Callable[[str], None]:
    """Tell people what goes on; it takes minutes."""
    plugins = request.config.pluginmanager
    reporter, capture = plugins.getplugin("terminalreporter"), plugins.getplugin("capturemanager")
    begin_s = time.monotonic()

    def line(text: str) -> None:
        with capture.global_and_fixture_disabled():
            reporter.write_line(f"docker: {time.monotonic() - begin_s:4.0f} s  {text}")

    return line


@pytest.fixture(scope="session")
def project(
    say: Callable[[str], None], tmp_path_factory: pytest.TempPathFactory
) -> Iterator[tuple[Path, dict[str, str]]]:
    """(folder of a built project, environment); skips where no engine can be had."""
    try:
        docker.install(say)
        with docker.engine(say) as environment:
            base = docker.base_image(environment, say)
            found = docker.wheels(say)
            folder = tmp_path_factory.mktemp("compose")
            for name in CONTEXT:
                source = ROOT / name
                if source.is_dir():
                    ignored = shutil.ignore_patterns("__pycache__")
                    shutil.copytree(source, folder / name, ignore=ignored)
                else:
                    shutil.copy(source, folder)
            shutil.copytree(found, folder / "wheels")
            (folder / "docker-compose.override.yml").write_text(OVERRIDE)
            (folder / HOLD_FOLDER).mkdir()
            environment |= {"COMPOSE_PROJECT_NAME": PROJECT, "COMPOSE_HTTP_TIMEOUT": "300"}
            environment |= {"BASE": base, "MRBT_SPEED": "10"}
            (folder / BROKER_FILE).write_text("listener 1883\nallow_anonymous true\n")
            (folder / NODE_FOLDER).mkdir()
            say("building the image")
            compose = Compose(folder, environment)
            compose("build", timeout_s=900)
            size = compose.docker("image", "inspect", "--format", "{{.Size}}", "mrbt-mesh")
            own = int(size) - int(compose.docker("image", "inspect", "--format", "{{.Size}}", base))
            say(f"the image has {int(size) / 1e6:.0f} MB, {own / 1e6:.0f} MB beyond its base")
            yield folder, environment
    except NoEngineError as error:
        pytest.skip(f"no Docker engine: {error}")


@pytest.fixture
def compose(project: tuple[Path, dict[str, str]]) -> Iterator[Compose]:
    """The demo, not started yet; nothing of it is left afterwards."""
    result = Compose(*project)
    try:
        yield result
    finally:
        result.clean()
