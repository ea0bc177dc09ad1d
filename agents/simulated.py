"""What the simulated robots share: work that takes time."""

import os
from pathlib import Path

import anyio

from mrbt_mesh import TaskContext

STEPS = 20
# Names a file that says what is held: see `held`.
HOLD_VARIABLE = "MRBT_HOLD"
HOLD_POLL_S = 0.02


async def work(task: TaskContext) -> None:
    """Take as long as this robot needs: work / (performance * speed) seconds.

    While it is held, it has started and does not go on.
    """
    await held(task)
    step_s = task.simulation.duration_s / STEPS
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
        return Path(path).read_text(encoding="utf-8").splitlines()
    except FileNotFoundError:
        return []
