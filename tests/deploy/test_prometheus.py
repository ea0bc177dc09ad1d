"""What deploy/prometheus/ says of metrics is true: they exist, and Prometheus' own tool agrees."""

from __future__ import annotations

import asyncio
import json
import re
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.request import urlopen

import pytest
from ruamel.yaml import YAML

from mrbt_mesh.adapters.metrics.families import Family, FamilyKind
from mrbt_mesh.adapters.metrics.pages import robot_page, team_page
from mrbt_mesh.adapters.metrics.server import metrics_app, read_in_loop, serving
from mrbt_mesh.plugins import MetricsAddress
from tests.support.metered import MeteredTeam
from tests.support.paths import ROOT

FOLDER = ROOT / "deploy" / "prometheus"
ALERTS, BOARD = FOLDER / "alerts.yml", FOLDER / "grafana-board.json"
PROMTOOL = shutil.which("promtool")
needs_promtool = pytest.mark.skipif(
    PROMTOOL is None, reason="promtool is not installed (Debian: apt-get install prometheus)"
)
# What Prometheus adds to a family's name for each of its series.
SERIES = {
    FamilyKind.GAUGE: ("",),
    FamilyKind.COUNTER: ("_total",),
    FamilyKind.INFO: ("_info",),
    FamilyKind.HISTOGRAM: ("_bucket", "_count", "_sum"),
}


def families() -> list[Family]:
    team = MeteredTeam("succeed A", "pass 300", "kill B", "pass 2000")
    loop = asyncio.new_event_loop()
    loop.close()
    pages = [*robot_page(team.view, team.meter), *team_page(team.observer)]
    return [*read_in_loop(loop, list), *pages]


def series() -> dict[str, set[str]]:
    """Every series that is served, with its labels."""
    return {
        family.name + suffix: {*family.labels, *(["le"] if suffix == "_bucket" else [])}
        for family in families()
        for suffix in SERIES[family.kind]
    }


def expressions() -> Iterator[tuple[str, str]]:
    """(where, expression) of each alert, and of each panel of the board."""
    for group in YAML(typ="safe").load(ALERTS.read_text())["groups"]:
        for rule in group["rules"]:
            yield rule["alert"], rule["expr"]
    board = json.loads(BOARD.read_text())
    for panel in board["panels"]:
        for target in panel["targets"]:
            yield panel["title"], target["expr"]
    for variable in board["templating"]["list"]:
        if variable["type"] == "query":
            yield variable["name"], variable["query"]["query"]


@pytest.mark.parametrize(("where", "expression"), list(expressions()))
def test_series_and_labels_exist(where: str, expression: str) -> None:
    known = series()
    # `run` and `robot` are labels of every robot that the run directory lists.
    listed = {"run", "robot"}
    names = re.findall(r"mrbt_\w+", expression)
    assert names
    for name in names:
        assert name in known, f"{where} asks for {name}"
    for name, matchers in re.findall(r"(mrbt_\w+)\{([^}]*)\}", expression):
        used = set(re.findall(r"(\w+)=", matchers))
        assert used <= known[name] | listed, f"{where}: {name} has no label {used - known[name]}"
    for used in re.findall(r"by \(([^)]*)\)", expression):
        labels = set(re.findall(r"\w+", used))
        assert labels <= set.union(*(known[name] for name in names)) | listed, where


def test_the_board_shows_what_an_operator_asks_first() -> None:
    titles = [panel["title"] for panel in json.loads(BOARD.read_text())["panels"]]
    assert len(titles) == len(set(titles))
    assert titles[:3] == ["Mission", "Robots by state", "All agree"]


@needs_promtool
def test_promtool_accepts_config_and_rules() -> None:
    configs = [("config", FOLDER / name) for name in ("prometheus.yml", "compose.yml")]
    for kind, path in (*configs, ("rules", ALERTS)):
        done = promtool("check", kind, str(path))
        assert "SUCCESS" in done.stdout


def test_the_composed_prometheus_asks_whom_there_is() -> None:
    """Each robot at the port that it is given, and the page under its own name."""
    services = YAML(typ="safe").load((ROOT / "docker-compose.yml").read_text())["services"]
    asked: dict[str, str] = {}
    for job in YAML(typ="safe").load((FOLDER / "compose.yml").read_text())["scrape_configs"]:
        for group in job["static_configs"]:
            for target in group["targets"]:
                name, _, port = target.partition(":")
                asked[name] = port
                words = services[name]["command"].split()
                option = "--port" if name == "page" else "--metrics-port"
                host = "--host" if name == "page" else "--metrics-host"
                assert words[words.index(option) + 1] == port
                assert words[words.index(host) + 1] == "0.0.0.0"
                assert services[name]["hostname"] == name
                if name != "page":
                    robot = group["labels"]["robot"]
                    assert words[words.index("--robot") + 1] == robot
    robots = {name for name, each in services.items() if "hostname" in each}
    assert robots == set(asked)
    prometheus = services["prometheus"]
    assert "--config.file=/etc/mrbt/compose.yml" in prometheus["command"]
    assert prometheus["profiles"] == services["page"]["profiles"] == ["metrics"]
    for name in ("page", "prometheus"):
        assert all(port.startswith("127.0.0.1:") for port in services[name]["ports"])


@needs_promtool
def test_promtool_accepts_the_metrics() -> None:
    with serving(MetricsAddress(0), metrics_app(families)) as port:
        text = urlopen(f"http://127.0.0.1:{port}/metrics", timeout=10).read()
    done = promtool("check", "metrics", text=text)
    assert done.stdout == done.stderr == ""


@needs_promtool
@pytest.mark.parametrize(
    ("alert", "series", "at", "labels"),
    [
        ("RobotDead", {'mrbt_peer_dead{run="r",robot="B",peer="A"}': "1x20"}, "30s", {"run": "r"}),
        ("RequestBlocked", {'mrbt_requests{run="r",state="blocked"}': "2x20"}, "30s", {"run": "r"}),
        (
            "NoAgreement",
            {'mrbt_agreement{instance="i"}': "0x20", 'mrbt_joined{instance="i"}': "1x20"},
            "30s",
            {"instance": "i"},
        ),
        (
            "MessagesRefused",
            {'mrbt_refused_messages_total{robot="A",reason="flood"}': "0+100x40"},
            "2m",
            {"robot": "A", "reason": "flood"},
        ),
        (
            "EventLoopLate",
            {
                'mrbt_event_loop_lag_seconds_bucket{robot="A",le="0.1"}': "0+1x40",
                'mrbt_event_loop_lag_seconds_bucket{robot="A",le="0.25"}': "0+20x40",
                'mrbt_event_loop_lag_seconds_bucket{robot="A",le="+Inf"}': "0+20x40",
            },
            "2m",
            {"robot": "A"},
        ),
    ],
)
def test_alerts_fire(
    alert: str, series: dict[str, str], at: str, labels: dict[str, str], tmp_path: Path
) -> None:
    """With these series, one sample every five seconds; and with none of them nothing fires."""
    rules = {"rule_files": [str(ALERTS)], "evaluation_interval": "5s"}
    for name, holds in (("with", True), ("without", False)):
        test = {
            "interval": "5s",
            "input_series": [{"series": s, "values": v} for s, v in series.items()] * holds,
            "alert_rule_test": [{"eval_time": at, "alertname": alert, **expected(labels, holds)}],
        }
        path = tmp_path / f"{name}.yml"
        path.write_text(json.dumps(rules | {"tests": [test]}))
        done = promtool("test", "rules", str(path), check=False)
        # Texts of the alert are no part of this: only whether it is there, and for whom.
        got = re.findall(rf'got:\[\s*(?:0:)?\s*Labels:{{alertname="{alert}"([^}}]*)}}', done.stderr)
        found = {part.strip() for text in got for part in text.split(",")}
        assert bool(got) is holds, done.stdout + done.stderr
        assert {f'{key}="{value}"' for key, value in labels.items()} <= found or not holds


def expected(labels: dict[str, str], holds: bool) -> dict[str, Any]:
    """Something that is never so, for promtool to say what is; or nothing at all."""
    return {"exp_alerts": [{"exp_labels": {"none": "such"}}] if holds else []}


def promtool(*words: str, text: bytes | None = None, check: bool = True) -> Any:
    assert PROMTOOL is not None
    done = subprocess.run([PROMTOOL, *words], input=text, capture_output=True, timeout=60)
    done.stdout, done.stderr = done.stdout.decode(), done.stderr.decode()
    assert not check or done.returncode == 0, done.stdout + done.stderr
    return done
