"""Forks the robots of a team, so that their common modules are loaded once.

    python -m mrbt_mesh.cli.fork_server RUN_DIR [arrays]

Reads requests from standard input, one line of JSON each: a robot, and its arguments of `mrbt`.
Writes to standard output the pid of each robot, and later its exit status. `runtime/robot_forks.py`
is the other end. The server ends with its launcher; its robots keep running.

Nothing may be started here that does not survive a fork, such as a Zenoh session or a thread.
numpy's library has threads, but ends them itself before a fork.
"""

from __future__ import annotations

import contextlib
import gc
import importlib
import json
import os
import select
import signal
import sys
from typing import Any, NoReturn

from mrbt_mesh.cli.command import end_process
from mrbt_mesh.cli.main import main

# Modules that a robot loads before it has read its mission.
LOADED_ONCE = (
    "anyio._backends._asyncio",
    "mrbt_mesh.cli.commands.agent",
    "mrbt_mesh.runtime.key_folder",
    "mrbt_mesh.runtime.robot_process",
)
# Modules that robots of a large team load as well.
LOADED_FOR_ARRAYS = (
    "mrbt_mesh.core.assignment.canonical",
    "ortools.graph.python.min_cost_flow",
)
REQUESTS, ANSWERS = 0, 1
CHUNK = 1 << 16
MAX_NAME = 15  # of a process, on Linux


def serve(arrays: bool) -> None:
    """Fork robots until the launcher ends; with `arrays`, those of a large team."""
    for module in (*LOADED_ONCE, *(LOADED_FOR_ARRAYS if arrays else ())):
        importlib.import_module(module)
    gc.collect()
    gc.freeze()  # pages that the collector never writes to stay shared with the robots
    ended, end = os.pipe()
    os.set_blocking(end, False)
    signal.set_wakeup_fd(end)
    signal.signal(signal.SIGCHLD, lambda *_: None)
    waiting = b""
    while True:
        ready, _, _ = select.select([REQUESTS, ended], [], [])
        if ended in ready:
            os.read(ended, CHUNK)
        _report_ended()
        if REQUESTS not in ready:
            continue
        data = os.read(REQUESTS, CHUNK)
        if not data:
            return
        *lines, waiting = (waiting + data).split(b"\n")
        for line in lines:
            request = json.loads(line)
            pid = os.fork()
            if pid == 0:
                os.close(ended)
                os.close(end)
                _become_robot(request)
            _answer({"robot": request["robot"], "pid": pid})


def _answer(news: dict[str, Any]) -> None:
    os.write(ANSWERS, json.dumps(news).encode() + b"\n")


def _report_ended() -> None:
    with contextlib.suppress(ChildProcessError):
        while (ended := os.waitpid(-1, os.WNOHANG))[0]:
            _answer({"pid": ended[0], "status": os.waitstatus_to_exitcode(ended[1])})


def _become_robot(request: dict[str, Any]) -> NoReturn:
    """Run `mrbt` in a new session, with the robot's output file."""
    signal.set_wakeup_fd(-1)
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    os.setsid()
    nothing = os.open(os.devnull, os.O_RDONLY)
    output = os.open(
        request["output"], os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_NOFOLLOW, 0o600
    )
    for descriptor, standard in ((nothing, 0), (output, 1), (output, 2)):
        os.dup2(descriptor, standard)
    os.close(nothing)
    os.close(output)
    # For `ps` and `top`: all robots share the command line of this process.
    with contextlib.suppress(OSError), open("/proc/self/comm", "w") as name:
        name.write(f"mrbt {request['robot']}"[:MAX_NAME])
    sys.argv = ["mrbt", *request["arguments"]]
    code: Any = 1
    try:
        main()
    except SystemExit as error:
        code = error.code
    except BaseException:  # in any case this process must not continue as its parent does
        sys.excepthook(*sys.exc_info())
    end_process(code)


if __name__ == "__main__":
    with contextlib.suppress(BrokenPipeError):
        serve("arrays" in sys.argv[2:])
