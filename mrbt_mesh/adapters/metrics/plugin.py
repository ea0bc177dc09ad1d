"""Prometheus metrics as a plug-in (`plugins.Metrics`)."""

from __future__ import annotations

import asyncio
from contextlib import AbstractContextManager
from functools import partial

from mrbt_mesh.adapters.metrics.meter import Meter
from mrbt_mesh.adapters.metrics.pages import robot_page, team_page
from mrbt_mesh.adapters.metrics.server import (
    ReadFamilies,
    metrics_app,
    read_in_loop,
    require_library,
    serving,
    written,
)
from mrbt_mesh.core.agent.view import AgentView
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.observer.observer import Observer
from mrbt_mesh.plugins import MetricsAddress


class ServedMeter(Meter):
    """The meter of one robot, served at an address."""

    def __init__(self, robot: str, mission: Mission, address: MetricsAddress) -> None:
        super().__init__(robot, mission)
        self._address = address

    def serving(self, view: AgentView) -> AbstractContextManager[int]:
        """Serve the robot's page. Must be called in its event loop. Raises InputError."""
        return _serving(self._address, partial(robot_page, view, self))


class PrometheusMetrics:
    """Implements `plugins.Metrics`."""

    def check(self) -> None:
        """Raise InputError if the library is missing."""
        require_library()

    def meter(self, robot: str, mission: Mission, address: MetricsAddress) -> ServedMeter:
        """Return the meter of one robot. Raises InputError if the library is missing."""
        require_library()
        return ServedMeter(robot, mission, address)

    def serving_team(
        self, observer: Observer, address: MetricsAddress
    ) -> AbstractContextManager[int]:
        """Serve a team's page. Must be called in the event loop. Raises InputError."""
        return _serving(address, partial(team_page, observer))

    def team_page(self, observer: Observer, accept: str) -> tuple[bytes, str]:
        """Return a team's page for this `Accept` header, and its content type."""
        return written(partial(team_page, observer), accept)


def _serving(address: MetricsAddress, read: ReadFamilies) -> AbstractContextManager[int]:
    return serving(address, metrics_app(partial(read_in_loop, asyncio.get_running_loop(), read)))


metrics = PrometheusMetrics()
