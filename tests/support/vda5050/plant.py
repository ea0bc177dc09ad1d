"""A warehouse of other people's making: mosquitto, and virtual AGVs of npm's vda-5050-lib.

`Plant` starts and ends them, and listens to all that is said: the record of what the vehicles did.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import socket
import subprocess
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tests.support.heard import WAIT_S, Heard
from tests.support.paths import EXAMPLES, ROOT

# The folder with node_modules/vda-5050-lib: `make test-vda5050` makes it.
LIBRARY_VARIABLE = "MRBT_VDA5050_NODE"
HOST = "127.0.0.1"
SCRIPT = EXAMPLES / "warehouse/virtual_agvs.js"
# Robot -> manufacturer, version, x, y, node.
VEHICLES: dict[str, dict[str, Any]] = json.loads(SCRIPT.with_suffix(".json").read_text())


def lacking() -> str:
    """What is missing for such a plant, and how to get it; empty if nothing is."""
    if shutil.which("mosquitto") is None:
        return "mosquitto is not installed: make test-vda5050 as root, or apt-get install mosquitto"
    if shutil.which("node") is None:
        return "node is not installed: apt-get install nodejs npm"
    folder = os.environ.get(LIBRARY_VARIABLE, "")
    if not (Path(folder) / "node_modules/vda-5050-lib").is_dir():
        return f"{LIBRARY_VARIABLE} names no folder with vda-5050-lib: make test-vda5050"
    return ""


@dataclass(frozen=True)
class Said:
    """A message as it passed the broker. `at_s` counts from the plant's start."""

    at_s: float
    robot: str
    topic: str
    body: dict[str, Any]


class Plant:
    """The broker and the vehicles. Ended whatever happens."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.port = free_port()
        self._heard = Heard[Said]()
        self.heard = self._heard.messages
        self._broker: subprocess.Popen[bytes] | None = None
        self._vehicles: dict[str, subprocess.Popen[bytes]] = {}
        self._client: Any = None
        self._began_s = time.monotonic()

    def __enter__(self) -> Plant:
        self.start_broker()
        self._listen()
        return self

    def __exit__(self, *error: object) -> None:
        if self._client is not None:
            self._client.disconnect()
            self._client.loop_stop()
        for process in [*self._vehicles.values(), self._broker]:
            if process is not None and process.poll() is None:
                process.kill()
                process.wait()

    # -- processes -----------------------------------------------------------------------------

    def start_broker(self) -> None:
        """Start mosquitto; it keeps nothing of what was before."""
        config = self.folder / "mosquitto.conf"
        config.write_text(f"listener {self.port} {HOST}\nallow_anonymous true\npersistence false\n")
        with (self.folder / "mosquitto.log").open("a") as log:
            self._broker = subprocess.Popen(
                ["mosquitto", "-c", str(config)], stdout=log, stderr=log
            )
        tick = threading.Event()
        for _ in range(int(WAIT_S / 0.05)):
            try:
                socket.create_connection((HOST, self.port), timeout=1).close()
                return
            except OSError:
                tick.wait(0.05)
        raise AssertionError("mosquitto does not listen")

    def kill_broker(self) -> None:
        """SIGKILL: no last will is sent, nothing is kept."""
        assert self._broker is not None
        self._broker.kill()
        self._broker.wait()

    def stop_broker(self) -> None:
        """SIGTERM: it ends in order, and sends all last wills."""
        assert self._broker is not None
        self._broker.terminate()
        self._broker.wait()

    def start_vehicle(self, robot: str) -> None:
        """Start a virtual AGV at its station."""
        modules = Path(os.environ[LIBRARY_VARIABLE]) / "node_modules"
        with (self.folder / f"agv-{robot}.log").open("a") as log:
            self._vehicles[robot] = subprocess.Popen(
                ["node", str(SCRIPT), str(self.port), robot],
                env=os.environ | {"NODE_PATH": str(modules)},
                cwd=ROOT,
                stdout=log,
                stderr=log,
            )

    def kill_vehicle(self, robot: str) -> None:
        """SIGKILL: the broker sends its last will."""
        self._vehicles[robot].send_signal(signal.SIGKILL)
        self._vehicles[robot].wait()

    # -- what was said -------------------------------------------------------------------------

    def _listen(self) -> None:
        from paho.mqtt import client as mqtt

        def on_connect(client: Any, *_: Any) -> None:
            client.subscribe("uagv/#")

        def on_message(_client: Any, _data: Any, message: Any) -> None:
            robot, topic = message.topic.split("/")[3:5]
            at_s = time.monotonic() - self._began_s
            self._heard.add(Said(at_s, robot, topic, json.loads(message.payload)))

        client = self._client = mqtt.Client(mqtt.CallbackAPIVersion.VERSION2)
        client.on_connect, client.on_message = on_connect, on_message
        client.reconnect_delay_set(min_delay=1, max_delay=1)
        client.connect(HOST, self.port)
        client.loop_start()

    def wait_for(self, holds: Callable[[Said], bool], what: str, after_s: float = 0.0) -> Said:
        """The first message that `holds` accepts, since `after_s`."""
        return self._heard.wait_for(lambda each: each.at_s >= after_s and holds(each), what)

    def now_s(self) -> float:
        """The time by which messages are stamped."""
        return time.monotonic() - self._began_s

    def orders(self, robot: str | None = None) -> list[Said]:
        """Orders as they passed the broker; one that was sent again counts once."""
        found: dict[str, Said] = {}
        for each in self.heard:
            if each.topic == "order" and robot in (None, each.robot):
                found.setdefault(each.body["orderId"], each)
        return list(found.values())

    def states(self, robot: str) -> list[Said]:
        """The states that a vehicle said."""
        return [each for each in self.heard if each.topic == "state" and each.robot == robot]


def free_port() -> int:
    """A port that nobody uses now."""
    with socket.socket() as probe:
        probe.bind((HOST, 0))
        port: int = probe.getsockname()[1]
        return port


def stop_of(order: dict[str, Any]) -> list[str]:
    """The nodes of an order at which something is done."""
    return [node["nodeId"] for node in order["nodes"] if node["actions"]]
