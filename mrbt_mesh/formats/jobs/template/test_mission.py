"""What the team must do, in virtual time and with faults. Run it with `pytest`."""

import pytest

from mrbt_mesh.testing import Kill, RunMission, Submit


def test_a_job_is_done_by_one_robot(run_mission: RunMission) -> None:
    jobs = [(2, Submit("fetch", ["A", 2], id="one"))]
    run = run_mission("mission.yaml", commands=jobs, until_jobs_end=True)
    assert run.job("one").state == "succeeded"
    assert len(run.job("one").robots) == 1


@pytest.mark.parametrize("at_s", [4, 8, 12])
def test_whoever_dies_is_replaced(run_mission: RunMission, at_s: float) -> None:
    jobs = [(2, Submit("fetch", [shelf, 1], id=shelf)) for shelf in "ABC"]
    run = run_mission(
        "mission.yaml", commands=jobs, faults=[(at_s, Kill("R1"))], until_jobs_end=True
    )
    assert {job.state for job in run.jobs} == {"succeeded"}
