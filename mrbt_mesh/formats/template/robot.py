"""What a robot of this team can do: one async function per local task of mission.yaml."""

from collections.abc import Iterator
from contextlib import contextmanager

import anyio

from mrbt_mesh import RobotProgram, TaskContext

robot = RobotProgram()


@robot.local_task("look_at")
async def look_at(task: TaskContext, box: str) -> None:
    """The arguments of the local task come after the context, as text."""
    with recorded(task):
        await take_time(task)
        # The team hears of this in one step with the task's success.
        task.set_condition(f"heavy({box})", box in task.parameters["heavy_boxes"])


@robot.local_task("carry")
async def carry(task: TaskContext, box: str) -> None:
    """Replace the waiting by what your robot does. To fail: raise, or return False."""
    # `task.partners` are the robots that carry with this one, e.g. to agree on a grip.
    with recorded(task):
        await take_time(task)


async def take_time(task: TaskContext) -> None:
    """Stands in for real work. Any `await` may be cancelled when the plan changes."""
    seconds = task.work / (task.performance * task.speed)
    for step in range(1, 11):
        await anyio.sleep(seconds / 10)
        task.report_progress(step / 10)


@contextmanager
def recorded(task: TaskContext) -> Iterator[None]:
    """Write a line to the run's events.jsonl at the start and at the end of real work."""

    def record(event: str, outcome: str | None = None) -> None:
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

    record("start")
    try:
        yield
    except Exception:
        record("end", "failure")
        raise
    except BaseException:  # Cancelled: stop the motors here, then let it pass.
        record("cancel")
        raise
    record("end", "success")
