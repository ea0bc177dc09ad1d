"""The options that say where metrics are served."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

from mrbt_mesh.cli.framework.declare import Given, option

if TYPE_CHECKING:
    from mrbt_mesh.plugins import MetricsAddress

PANEL = "Metrics"
MOST_PORTS = 65_535
HostOption = Annotated[
    str,
    option(
        "Serve them on this address; 0.0.0.0: on all.", "IP", name="--metrics-host", panel=PANEL
    ),
]


@dataclass(frozen=True)
class MetricsOptions:
    """Where metrics for Prometheus are served, if anywhere."""

    metrics_port: Annotated[
        int | None,
        option(
            "Serve metrics for Prometheus (docs/metrics.md).",
            "PORT",
            panel=PANEL,
            least=1,
            most=MOST_PORTS,
        ),
    ] = None
    metrics_host: HostOption = "127.0.0.1"

    def address(self, given: Given) -> MetricsAddress | None:
        """What the options say; None: nowhere. Raises InputError for a host without a port."""
        if self.metrics_port is None:
            given.refuse(("--metrics-host",), "give --metrics-port too")
            return None
        from mrbt_mesh.plugins import MetricsAddress

        return MetricsAddress(self.metrics_port, self.metrics_host)
