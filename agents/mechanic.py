"""The robots of examples/lift: whatever one of them does takes its time, and changes what its
local task declares in team.yaml.
"""

from simulated import work

from mrbt_mesh import RobotProgram, TaskContext

robot = RobotProgram(record_work=True)

# Local task -> conditions that it changes, with its part in place of {}, and their new values.
EFFECTS = {
    "remove_screws": {"screwed": False},
    "remove_cover": {"covered": False},
    "diagnose": {"diagnosed({})": True},
    "replace_hw": {},
    "replace_wires": {},
    "solder": {},
    "place_cover": {"covered": True},
    "place_screws": {"screwed": True},
}


async def change(task: TaskContext, *part: str) -> None:
    """Work, then say what has changed, together with this task's outcome."""
    await work(task)
    for condition, value in EFFECTS[task.local_task.partition("(")[0]].items():
        task.set_condition(condition.format(*part), value)


for local_task in EFFECTS:
    robot.local_task(local_task)(change)
