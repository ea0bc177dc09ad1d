"""Which local tasks of a robot have a server now, and what the team hears of the others."""

from __future__ import annotations

from collections.abc import Mapping

import anyio

from mrbt_mesh.adapters.ros2.binding_file import BindingFile, KnownValues
from mrbt_mesh.runtime.context import RobotContext
from mrbt_mesh.runtime.log import robot_logger

# How reasons call what a local task is bound to.
_KINDS = {"action": "action server", "srv": "service", "msg": "topic"}


class Servers:
    """The servers of one robot's local tasks, all missing at first.

    While the robot starts (`start_up_s` of the file), one that was never found is not there yet.
    Later, or once it was there, it is a fault.
    """

    def __init__(self, file: BindingFile, robot: str, values: Mapping[str, str]) -> None:
        self._file = file
        self._values = KnownValues(values, {})
        self._log = robot_logger(robot)
        self._task: RobotContext | None = None
        self._missing = dict.fromkeys(file.local_tasks, "the bridge to ROS has not started")
        self._found: set[str] = set()
        self._is_starting = True

    def begin(self, task: RobotContext) -> None:
        """The robot has started: say what it cannot do before it fails at that."""
        self._task = task
        # A file may serve robots of several types.
        self._missing = {name: why for name, why in self._missing.items() if task.can(name)}
        for name, why in self._missing.items():
            self._tell(name, why)

    async def end_start_up(self) -> None:
        """Wait for the end of the start; what has not been found until then is a fault."""
        await anyio.sleep(self._file.start_up_s)
        self._is_starting = False
        for name, why in self._missing.items():
            if name not in self._found:
                self._tell(name, why)

    def is_there(self, name: str) -> bool:
        """Whether the server of a local task can be used."""
        return name not in self._missing

    def found(self, name: str) -> None:
        """The server can be used from now on."""
        assert self._task is not None
        if not self._task.can(name):
            return
        self._missing.pop(name, None)
        self._found.add(name)
        self._log.info("server_found", local_task=name)
        self._task.restore_capability(name)

    def lost(self, name: str, why: str) -> None:
        """The server cannot be used; `why` is a predicate, as `does not answer`."""
        binding = self._file.local_tasks[name]
        self._tell(name, f"{_KINDS[binding.kind]} {self._values.text(binding.name)} {why}")

    def all_lost(self, why: str) -> None:
        """None of the servers can be used."""
        for name in self._file.local_tasks:
            self._tell(name, why)

    def _tell(self, name: str, why: str) -> None:
        assert self._task is not None
        if not self._task.can(name):
            return
        self._missing[name] = why
        if self._is_starting and name not in self._found:
            self._log.info("server_awaited", local_task=name, reason=why)
            self._task.defer_capability(name, why)
        else:
            self._log.warning("server_lost", local_task=name, reason=why)
            self._task.lose_capability(name, why)
