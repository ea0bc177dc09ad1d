"""The robots of examples/tool_search: what they find is given by the mission's parameters."""

from simulated import work

from mrbt_mesh import RobotProgram, TaskContext, TaskFailedError

robot = RobotProgram(record_work=True)


@robot.local_task
async def search(task: TaskContext, storage: str) -> None:
    """Look for the tools; fails in the storage that has none."""
    await work(task)
    if storage != str(task.parameters["tools_in_storage"]):
        raise TaskFailedError(f"no tools in storage {storage}")


@robot.local_task
async def large_screwdriver(task: TaskContext) -> None:
    """Tighten with the large screwdriver; fails where it does not fit."""
    await work(task)
    if not task.parameters["large_fits"]:
        raise TaskFailedError("the large screwdriver does not fit")


@robot.local_task
async def small_screwdriver(task: TaskContext) -> None:
    """Tighten with the small screwdriver, which always fits but takes longer."""
    await work(task)
