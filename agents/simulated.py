"""What the simulated robots share: work that takes time, and the record of what was done.

`events.jsonl` holds the physical truth of a run: only the robots write to it, never the mesh.
"""

import functools
from collections.abc import Awaitable, Callable

import anyio

from mrbt_mesh import TaskContext

STEPS = 20


async def work(task: TaskContext) -> None:
    """Take as long as this robot needs: work / (performance * speed) seconds."""
    step_s = task.work / (task.performance * task.speed) / STEPS
    for step in range(1, STEPS + 1):
        await anyio.sleep(step_s)
        task.report_progress(step / STEPS)


def physical(
    function: Callable[..., Awaitable[bool | None]],
) -> Callable[..., Awaitable[bool | None]]:
    """Decorate a local task: exactly one line for its start and one for its end or cancellation.

    Returning False or raising is an end with failure. What is raised passes through.
    """

    @functools.wraps(function)
    async def recorded(task: TaskContext, *arguments: str) -> bool | None:
        _record(task, "start")
        try:
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
