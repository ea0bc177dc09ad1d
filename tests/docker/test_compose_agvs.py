"""The profile `vda5050` of docker-compose.yml: a broker, virtual AGVs, and a team that has them for
robots, each in a container. `make test-vda5050` gets what this needs.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.support import docker_engine as docker
from tests.support.docker_compose import AGV_PACKAGES, NODE_FOLDER, Compose, Lines
from tests.support.vda5050.plant import LIBRARY_VARIABLE, lacking

pytestmark = [
    pytest.mark.docker,
    pytest.mark.slow,
    pytest.mark.processes,
    pytest.mark.timeout(1_500),
    pytest.mark.skipif(bool(lacking()), reason=lacking()),
]
PROFILE = ("--profile", "vda5050")


@pytest.fixture
def warehouse(
    project: tuple[Path, dict[str, str]], say: Callable[[str], None]
) -> Iterator[Compose]:
    """The warehouse, not started yet. Its images stand for those that users pull."""
    folder, environment = project
    image = docker.base_image(environment, say, AGV_PACKAGES)
    library = Path(os.environ[LIBRARY_VARIABLE]) / "node_modules"
    shutil.copytree(library, folder / NODE_FOLDER / "node_modules", symlinks=True)
    compose = Compose(folder, environment | {"MOSQUITTO": image, "NODE": image})
    try:
        yield compose
    finally:
        compose.clean()


def test_the_shift_is_done_although_all_vehicles_are_gone_for_a_while(warehouse: Compose) -> None:
    running = warehouse.start(*PROFILE, "run", "--rm", "-T", "warehouse")
    lines = Lines(running)
    lines.until(r"(F\d): deliver\(")
    warehouse(*PROFILE, "kill", "agvs")
    lines.until(r"F\d lost ")
    warehouse(*PROFILE, "start", "agvs")
    lines.until("mission: success")
    assert running.wait(60) == 0
