"""The bridge's process: reads commands, writes reports, and spins ROS in one thread.

It ends when its standard input ends, so it ends with the robot's process in any case.
"""

from __future__ import annotations

import importlib
import importlib.util
import os
import queue
import signal
import sys
import threading
import time
from typing import Any

from .bridge import Bridge
from .checks import problems_of
from .values import UnfitError

CHUNK = 65_536


def main(arguments: list[str]) -> int:
    """Run the bridge. `arguments`: the folder of a msgpack package, for a Python without one."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # Redirect the output of libraries to standard error: standard output is for messages.
    messages = os.dup(1)
    os.dup2(2, 1)
    pipe = Pipe(_msgpack(arguments[0] if arguments else ""), 0, messages)
    bind = pipe.read()
    if bind is None:
        return 0
    try:
        import rclpy  # noqa: F401
    except ImportError as error:
        pipe.tell({"op": "failed", "text": _no_ros(error)})
        return pipe.close(2)
    problems = problems_of(bind)
    if problems or bind["check"]:
        pipe.tell({"op": "checked", "problems": problems})
        return pipe.close(0)
    try:
        return serve(bind, pipe)
    except UnfitError as problem:
        pipe.tell({"op": "failed", "text": str(problem)})
        return pipe.close(2)


def serve(bind: dict[str, Any], pipe: Pipe) -> int:
    """Serve the robot until it has ended."""
    from rclpy.exceptions import InvalidServiceNameException, InvalidTopicNameException

    from .ros import RosNode

    commands: queue.SimpleQueue[dict[str, Any] | None] = queue.SimpleQueue()

    def take() -> None:
        while not commands.empty():
            command = commands.get()
            if command is None:
                bridge.robot_gone()
            else:
                bridge.command(command)
        bridge.tick()

    tick_s = min(0.1, bind["detection_s"] / 10)
    try:
        ros = RosNode(bind["node"], tick_s, take, bind["arguments"])
    except (RuntimeError, ValueError) as error:
        raise UnfitError(
            f"ROS refuses the bridge's settings: {' '.join(str(error).split())}"
        ) from None
    bridge = Bridge(bind, pipe.tell, time.monotonic)

    def read() -> None:
        try:
            for command in iter(pipe.read, None):
                commands.put(command)
                ros.wake()
        finally:
            commands.put(None)
            ros.wake()

    try:
        bridge.connect(ros)
    except (InvalidServiceNameException, InvalidTopicNameException, ValueError) as error:
        raise UnfitError(" ".join(str(error).split())) from None
    pipe.tell({"op": "ready"})
    threading.Thread(target=read, daemon=True).start()
    ros.spin_while(lambda: not bridge.is_over)
    pipe.close(0)
    # Exit without waiting for threads of the middleware, which may take long.
    os._exit(0)


class Pipe:
    """Messages in and out.

    A separate thread writes them: a stopped robot that does not read must not keep this process
    from cancelling its goals.
    """

    def __init__(self, msgpack: Any, source: int, target: int) -> None:
        self._msgpack, self._source, self._target = msgpack, source, target
        self._unpacker = msgpack.Unpacker()
        self._outbox: queue.SimpleQueue[dict[str, Any] | None] = queue.SimpleQueue()
        self._writer = threading.Thread(target=self._write, daemon=True)
        self._writer.start()

    def read(self) -> dict[str, Any] | None:
        """Return the next message; None at the end of the input."""
        while True:
            for message in self._unpacker:
                found: dict[str, Any] = message
                return found
            chunk = os.read(self._source, CHUNK)
            if not chunk:
                return None
            self._unpacker.feed(chunk)

    def tell(self, message: dict[str, Any]) -> None:
        """Queue a message for sending. May be called from any thread."""
        self._outbox.put(message)

    def close(self, status: int) -> int:
        """Wait up to 1 s until all messages are sent. Returns `status`."""
        self._outbox.put(None)
        self._writer.join(timeout=1)
        return status

    def _write(self) -> None:
        while True:
            message = self._outbox.get()
            if message is None:
                return
            left = self._msgpack.packb(message)
            try:
                while left:
                    left = left[os.write(self._target, left) :]
            except OSError:
                # The robot has ended; the reader notices it, too.
                return


def _msgpack(folder: str) -> Any:
    try:
        return importlib.import_module("msgpack")
    except ImportError:
        spec = importlib.util.spec_from_file_location(
            "msgpack", os.path.join(folder, "__init__.py"), submodule_search_locations=[folder]
        )
        if spec is None or spec.loader is None:
            raise
        sys.modules["msgpack"] = module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        return module


def _no_ros(error: ImportError) -> str:
    version = ".".join(map(str, sys.version_info[:2]))
    return f"{sys.executable} (Python {version}) cannot import rclpy: {error}"
