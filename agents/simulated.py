"""What the simulated robots share: work that takes time, and the record of what was done.

`events.jsonl` holds the physical truth of a run: only the robots write to it, never the mesh.
"""

import functools
import os
from collections.abc import Awaitable, Callable
from pathlib import Path

import anyio

from mrbt_mesh import TaskContext

STEPS = 20
# Names a file that says what is held: see `held`.
HOLD_VARIABLE = "MRBT_HOLD"
HOLD_POLL_S = 0.02


async def work(task: TaskContext) -> None:
    """Take as long as this robot needs: work / (performance * speed) seconds."""
    step_s = task.work / (task.performance * task.speed) / STEPS
    for step in range(1, STEPS + 1):
        await anyio.sleep(step_s)
        task.report_progress(step / STEPS)


async def held(task: TaskContext) -> None:
    """Wait while a line of the file $MRBT_HOLD names this robot, its local task (ground, or only
    the type) or its global task.

    So drills and tests have the moment that they mean, however fast the machine is.
    """
    kind = task.local_task.partition("(")[0]
    names = {task.robot, task.local_task, kind, task.global_task}
    while not names.isdisjoint(_held_names()):
        await anyio.sleep(HOLD_POLL_S)


def _held_names() -> list[str]:
    path = os.environ.get(HOLD_VARIABLE)
    if path is None:
        return []
    try:
        return Path(path).read_text().splitlines()
    except FileNotFoundError:
        return []


def physical(
    function: Callable[..., Awaitable[bool | None]],
) -> Callable[..., Awaitable[bool | None]]:
    """Decorate a local task: exactly one line for its start and one for its end or cancellation.

    Returning False or raising is an end with failure. What is raised passes through. While it
    is held, it has started and does not go on.
    """

    @functools.wraps(function)
    async def recorded(task: TaskContext, *arguments: str) -> bool | None:
        _record(task, "start")
        try:
            await held(task)
            result = await function(task, *arguments)
        except Exception:
            _record(task, "end", "failure")
            raise
        except BaseException:
            # Cancelled: neither asyncio's nor trio's cancellation is an Exception.
            _record(task, "cancel")
            raise
        _record(task, "end", "failure" if result is False else "success")
        return result

    return recorded


def _record(task: TaskContext, event: str, outcome: str | None = None) -> None:
    task.record_event(
        {
            "t": task.unix_time_s(),
            "robot": task.robot,
            "pid": task.pid,
            "incarnation": task.incarnation,
            "event": event,
            "outcome": outcome,
            "activation": task.activation,
            "global_task": task.global_task,
            "local_task": task.local_task.partition("(")[0],
            "args": list(task.arguments),
        }
    )
