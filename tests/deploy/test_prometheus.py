"""What deploy/prometheus/ says of metrics is true: they exist, and Prometheus' own tool agrees."""

from __future__ import annotations

import asyncio
import contextlib
import json
import re
import shutil
import socket
import subprocess
import threading
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
PROMTOOL, PROMETHEUS = shutil.which("promtool"), shutil.which("prometheus")
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


def late(name: str, bound: str, labels: str = "") -> dict[str, str]:
    """A histogram whose samples all exceed the bound."""
    return {
        f'{name}_bucket{{{labels}le="{bound}"}}': "0x40",
        **{f'{name}_bucket{{{labels}le="{le}"}}': "0+20x40" for le in ("10.0", "+Inf")},
        f"{name}_count{{{labels}}}": "0+20x40",
    }


A = {"robot": "A"}
# Alert -> the series with which it fires, one sample every five seconds, and what it is about.
FIRING: dict[str, tuple[dict[str, str], dict[str, str]]] = {
    "RobotDead": ({'mrbt_peer_dead{run="r",robot="B",peer="A"}': "1x40"}, {"run": "r"}),
    "TeamNotHeard": ({}, {"severity": "critical"}),
    "DetectionSlow": (late("mrbt_team_detection_duration_seconds", "2.5"), {}),
    "TakeoverSlow": (late("mrbt_team_takeover_duration_seconds", "2.5"), {}),
    "RobotDoesNotAnswer": ({'mrbt_event_loop_responds{robot="A"}': "0x40"}, A),
    "NoAgreement": (
        {'mrbt_agreement{instance="i"}': "0x40", 'mrbt_joined{instance="i"}': "1x40"},
        {"instance": "i"},
    ),
    "RobotDoesNotJoin": ({'mrbt_joined{robot="A"}': "0x40"}, A),
    "RequestBlocked": ({'mrbt_requests{run="r",state="blocked"}': "2x40"}, {"run": "r"}),
    "MessagesRefused": (
        {'mrbt_refused_messages_total{robot="A",reason="flood"}': "0+100x40"},
        {"robot": "A", "reason": "flood"},
    ),
    "InboxOverflow": ({'mrbt_inbox_dropped_messages_total{robot="A"}': "0+1x40"}, A),
    "EventLoopLate": (late("mrbt_event_loop_lag_seconds", "0.1", 'robot="A",'), A),
    "JournalSlow": (late("mrbt_journal_sync_duration_seconds", "0.25", 'robot="A",'), A),
    "DiskFull": ({'mrbt_journal_problem{robot="A",reason="disk_full"}': "1x40"}, A),
    "JournalFails": ({'mrbt_journal_problem{robot="A",reason="other"}': "1x40"}, A),
    "RobotFencedItself": ({'mrbt_fencings_total{robot="A"}': "0+1x40"}, A),
    "MissionFailed": ({'mrbt_mission_status{run="r",status="failure"}': "1x40"}, {"run": "r"}),
}
# With these nothing fires.
CALM = {"mrbt_robot_info": "1x40"}


def test_every_alert_is_fired_here() -> None:
    (group,) = YAML(typ="safe").load(ALERTS.read_text())["groups"]
    assert {rule["alert"] for rule in group["rules"]} == FIRING.keys()


@pytest.mark.slow
@needs_promtool
@pytest.mark.parametrize("alert", FIRING)
def test_alerts_fire(alert: str, tmp_path: Path) -> None:
    series, labels = FIRING[alert]
    rules = {"rule_files": [str(ALERTS)], "evaluation_interval": "5s"}
    for name, holds in (("with", True), ("without", False)):
        given = series if holds else CALM
        test = {
            "interval": "5s",
            "input_series": [{"series": s, "values": v} for s, v in given.items()],
            "alert_rule_test": [{"eval_time": "2m", "alertname": alert, **expected(holds)}],
        }
        path = tmp_path / f"{name}.yml"
        path.write_text(json.dumps(rules | {"tests": [test]}))
        done = promtool("test", "rules", str(path), check=False)
        # Texts of the alert are no part of this: only whether it is there, and for whom.
        got = re.findall(rf'got:\[\s*(?:0:)?\s*Labels:{{alertname="{alert}"([^}}]*)}}', done.stderr)
        found = {part.strip() for text in got for part in text.split(",")}
        assert bool(got) is holds, done.stdout + done.stderr
        assert {f'{key}="{value}"' for key, value in labels.items()} <= found or not holds


@pytest.mark.skipif(PROMETHEUS is None, reason="no prometheus (Debian: apt-get install prometheus)")
def test_a_real_prometheus_reads_a_team_and_fires(tmp_path: Path) -> None:
    page = families()
    config = YAML(typ="safe").load((FOLDER / "prometheus.yml").read_text())
    config["global"] = {"scrape_interval": "1s", "evaluation_interval": "1s"}
    config["rule_files"] = [str(ALERTS)]
    with serving(MetricsAddress(0), metrics_app(lambda: page)) as port, socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"127.0.0.1:{free.getsockname()[1]}"
        free.close()
        targets = [{"targets": [f"127.0.0.1:{port}"]}]
        config["scrape_configs"] = [{"job_name": "mrbt-robots", "static_configs": targets}]
        path = tmp_path / "prometheus.yml"
        path.write_text(json.dumps(config))
        words = (f"--config.file={path}", f"--storage.tsdb.path={tmp_path / 'data'}")
        with (tmp_path / "out").open("w") as output:
            process = subprocess.Popen(
                [str(PROMETHEUS), *words, f"--web.listen-address={address}"],
                stdout=output,
                stderr=output,
            )
        try:
            firing = wait_until_firing(address)
        finally:
            process.terminate()
            process.wait(30)
    assert {"RobotDead", "RequestBlocked"} & firing, (tmp_path / "out").read_text()
    assert "TeamNotHeard" not in firing


def wait_until_firing(address: str) -> set[str]:
    """The alerts that fire, once any does."""
    for _ in range(600):
        with contextlib.suppress(OSError):
            text = urlopen(f"http://{address}/api/v1/alerts", timeout=5).read()
            alerts = json.loads(text)["data"]["alerts"]
            if firing := {a["labels"]["alertname"] for a in alerts if a["state"] == "firing"}:
                return firing
        threading.Event().wait(0.1)
    return set()


def expected(holds: bool) -> dict[str, Any]:
    """Something that is never so, for promtool to say what is; or nothing at all."""
    return {"exp_alerts": [{"exp_labels": {"none": "such"}}] if holds else []}


def promtool(*words: str, text: bytes | None = None, check: bool = True) -> Any:
    assert PROMTOOL is not None
    done = subprocess.run([PROMTOOL, *words], input=text, capture_output=True, timeout=60)
    done.stdout, done.stderr = done.stdout.decode(), done.stderr.decode()
    assert not check or done.returncode == 0, done.stdout + done.stderr
    return done
