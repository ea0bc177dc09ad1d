"""What docker-compose.yml says of services that `make test-docker` does not start."""

from __future__ import annotations

import json
from typing import Any

from ruamel.yaml import YAML

from mrbt_mesh.formats.mission_file import load_mission
from tests.support.paths import EXAMPLES, ROOT

SERVICES: dict[str, Any] = YAML(typ="safe").load((ROOT / "docker-compose.yml").read_text())[
    "services"
]
WAREHOUSE = EXAMPLES / "warehouse"


def test_the_warehouse_is_a_team_of_the_virtual_agvs_at_the_broker_of_the_profile() -> None:
    broker, agvs, team = (SERVICES[name] for name in ("broker", "agvs", "warehouse"))
    assert [each["profiles"] for each in (broker, agvs, team)] == [["vda5050"]] * 3
    words = team["command"].split()
    assert words[:3] == ["mrbt", "up", "examples/warehouse/mission.yaml"]
    assert (ROOT / words[words.index("--program") + 1]).is_file()
    host, _, port = team["environment"]["MRBT_VDA5050_BROKER"].partition(":")
    assert SERVICES[host] is broker
    assert broker["networks"] == team["networks"]
    assert agvs["network_mode"] == f"service:{host}"
    assert f"virtual_agvs.js {port}" in agvs["command"]
    vehicles = json.loads((WAREHOUSE / "virtual_agvs.json").read_text())
    assert vehicles.keys() == load_mission(WAREHOUSE / "mission.yaml").robots.keys()


def test_the_image_has_what_its_services_import() -> None:
    """The extras that deploy/Dockerfile installs."""
    dockerfile = (ROOT / "deploy" / "Dockerfile").read_text()
    for extra in ("planner", "terminal", "web", "metrics", "vda5050"):
        assert f"'{extra}'" in dockerfile
