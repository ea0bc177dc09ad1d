"""Tracks which local tasks of a robot have a server, and reports the missing ones to the team."""

from __future__ import annotations

from collections.abc import Mapping

import anyio

from mrbt_mesh.adapters.binding import KnownValues, LostCapabilities
from mrbt_mesh.adapters.ros2.binding_file import BindingFile
from mrbt_mesh.runtime.context import RobotContext
from mrbt_mesh.runtime.log import robot_logger

# The words for kinds of servers in reasons.
_KINDS = {"action": "action server", "srv": "service", "msg": "topic"}


class Servers:
    """The servers of one robot's local tasks, all missing at first.

    During start-up (`start_up_s` of the file), a server that was never found is only awaited.
    Afterwards, or once it was found, a missing server is a fault.
    """

    def __init__(self, file: BindingFile, robot: str, values: Mapping[str, str]) -> None:
        self._file = file
        self._values = KnownValues(values)
        self._log = robot_logger(robot)
        self._robot: RobotContext | None = None
        self._missing = dict.fromkeys(file.local_tasks, "the bridge to ROS has not started")
        self._found: set[str] = set()
        self._is_starting = True
        self._lost = LostCapabilities()

    def begin(self, robot: RobotContext) -> None:
        """Called when the robot has started: report missing capabilities before a task fails."""
        self._robot = robot
        self._tell()

    async def end_start_up(self) -> None:
        """Wait for the end of the start-up; from then on, missing servers are faults."""
        await anyio.sleep(self._file.start_up_s)
        self._is_starting = False
        self._tell()

    def is_there(self, name: str) -> bool:
        """Return whether the server of a local task can be used."""
        return name not in self._missing

    def called(self, name: str) -> str:
        """Return the description of a local task's server that is used in reasons."""
        binding, namespace = self._file.local_tasks[name], self._file.bridge.namespace or ""
        text = binding.name
        if not text.startswith(("/", "~")):
            text = f"/{namespace.strip('/')}/{text}" if namespace.strip("/") else f"/{text}"
        return f"{_KINDS[binding.kind]} {self._values.text(text)}"

    def found(self, name: str) -> None:
        """Note that a server can be used from now on."""
        self._log.info("server_found", local_task=name)
        self._missing.pop(name, None)
        self._found.add(name)
        self._tell()

    def lost(self, name: str, why: str) -> None:
        """Note that a server cannot be used; `why` is a predicate, like `does not answer`."""
        reason = f"{self.called(name)} {why}"
        if self._is_starting and name not in self._found:
            self._log.info("server_awaited", local_task=name, reason=reason)
        else:
            self._log.warning("server_lost", local_task=name, reason=reason)
        self._missing[name] = reason
        self._tell()

    def all_lost(self, why: str) -> None:
        """Note that no server can be used."""
        self._log.warning("servers_lost", reason=why)
        self._missing = dict.fromkeys(self._file.local_tasks, why)
        self._tell()

    def _tell(self) -> None:
        robot = self._robot
        assert robot is not None
        lost = {
            name: (why, self._is_starting and name not in self._found)
            for name, why in self._missing.items()
            if robot.can(name)  # a file may serve robots of several types
        }
        self._lost.tell(robot, lost)
