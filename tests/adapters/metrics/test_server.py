"""Metrics over HTTP, read with the library's own parser."""

from __future__ import annotations

import asyncio
import contextlib
import socket
import threading
from urllib.request import Request, urlopen

import anyio.to_thread
import pytest
from prometheus_client.openmetrics.parser import text_string_to_metric_families as parse_openmetrics
from prometheus_client.parser import text_string_to_metric_families as parse_text

from mrbt_mesh.adapters.metrics import server
from mrbt_mesh.adapters.metrics.families import (
    Distribution,
    Family,
    FamilyKind,
    counter,
    family,
    gauge,
    histogram,
)
from mrbt_mesh.adapters.metrics.pages import robot_page, team_page
from mrbt_mesh.adapters.metrics.server import metrics_app, read_in_loop, serving
from mrbt_mesh.errors import InputError
from mrbt_mesh.plugins import MetricsAddress
from tests.support.extras import said_without
from tests.support.metered import MeteredTeam

LOCALHOST = "127.0.0.1"
OPENMETRICS = "application/openmetrics-text; version=1.0.0"


def families() -> list[Family]:
    durations = Distribution((0.1, 1.0))
    durations.observe(0.5)
    counts = {("A",): 3.0, ('odd "name"\n',): 1.0}
    return [
        gauge("mrbt_g", "A gauge.", 1.5),
        counter("mrbt_c", "A counter.", counts, "robot"),
        family(FamilyKind.INFO, "mrbt_i", "Info.", {("1", "2"): 1.0}, "a", "b"),
        histogram("mrbt_h_seconds", "Durations.", durations),
    ]


def fetch(port: int, accept: str = "text/plain") -> tuple[str, str]:
    request = Request(f"http://{LOCALHOST}:{port}/metrics", headers={"Accept": accept})
    with urlopen(request, timeout=10) as answer:
        return answer.read().decode(), answer.headers["Content-Type"]


def test_what_is_served_is_what_was_said() -> None:
    with serving(MetricsAddress(0), metrics_app(families)) as port:
        text, _ = fetch(port)
        precise, kind = fetch(port, OPENMETRICS)
    assert kind.startswith("application/openmetrics-text")
    for found in (parse_text(text), parse_openmetrics(precise)):
        samples = {(s.name, *sorted(s.labels.items())): s.value for f in found for s in f.samples}
        assert samples["mrbt_g",] == 1.5
        assert samples["mrbt_c_total", ("robot", "A")] == 3
        assert samples["mrbt_c_total", ("robot", 'odd "name"\n')] == 1
        assert samples["mrbt_i_info", ("a", "1"), ("b", "2")] == 1
        assert samples["mrbt_h_seconds_bucket", ("le", "0.1")] == 0
        assert samples["mrbt_h_seconds_bucket", ("le", "1.0")] == 1
        assert samples["mrbt_h_seconds_count",] == 1
        assert samples["mrbt_h_seconds_sum",] == 0.5


def test_the_pages_of_robots_and_teams_are_openmetrics() -> None:
    team = MeteredTeam("succeed A", "pass 300", "kill B", "pass 2000")
    read = lambda: [*robot_page(team.view, team.meter), *team_page(team.observer)]  # noqa: E731
    with serving(MetricsAddress(0), metrics_app(read)) as port:
        text, _ = fetch(port, OPENMETRICS)
    names = {family.name for family in parse_openmetrics(text)}
    assert {family.name for family in read()} <= names


def test_a_port_that_is_taken_is_said() -> None:
    with socket.socket() as taken:
        taken.bind((LOCALHOST, 0))
        taken.listen()
        address = MetricsAddress(taken.getsockname()[1])
        with (
            pytest.raises(InputError, match=f"served on {address}: Address already in use"),
            serving(address, metrics_app(families)),
        ):
            pass


def test_who_connects_and_says_nothing_holds_up_others_only_for_a_while(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(server._Handler, "timeout", 0.05)
    with (
        serving(MetricsAddress(0), metrics_app(families)) as port,
        socket.create_connection((LOCALHOST, port)),
    ):
        assert "mrbt_g" in fetch(port)[0]


def test_who_says_a_byte_now_and_then_holds_up_others_and_the_end_only_for_a_while(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(server, "WHOLE_REQUEST_S", 0.2, raising=False)
    is_over = threading.Event()

    def say_slowly(connection: socket.socket) -> None:
        with contextlib.suppress(OSError):
            for _ in range(500):  # ten seconds, or until it is cut off
                connection.sendall(b"G")
                if is_over.wait(0.02):
                    return

    with socket.socket() as slow:
        with serving(MetricsAddress(0), metrics_app(families)) as port:
            slow.connect((LOCALHOST, port))
            talking = threading.Thread(target=say_slowly, args=(slow,))
            talking.start()
            with urlopen(f"http://{LOCALHOST}:{port}/metrics", timeout=5) as answer:
                assert b"mrbt_g" in answer.read()
        is_over.set()
        talking.join()


async def test_families_are_read_in_the_loop() -> None:
    here, found = threading.get_ident(), []

    def read() -> list[Family]:
        found.append(threading.get_ident())
        return families()

    loop = asyncio.get_running_loop()
    page = await anyio.to_thread.run_sync(read_in_loop, loop, read)
    assert found == [here]
    assert [(family.name, family.samples[0][1]) for family in page[:1]] == [(server.RESPONDS, 1.0)]
    assert len(page) == 1 + len(families())


def test_a_loop_that_hangs_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(server, "LOOP_TIMEOUT_S", 0.01)
    loop = asyncio.new_event_loop()  # it never runs
    try:
        (only,) = read_in_loop(loop, families)
    finally:
        loop.close()
    assert (only.name, only.samples) == (server.RESPONDS, (((), 0.0),))
    (after,) = read_in_loop(loop, families)
    assert after.samples == (((), 0.0),)


def test_without_the_library_it_is_said_how_to_get_it() -> None:
    said = said_without(
        "prometheus_client", "mrbt_mesh.adapters.metrics.server", "metrics_app(list)"
    )
    assert "pip install 'mrbt-mesh[metrics]'" in said
