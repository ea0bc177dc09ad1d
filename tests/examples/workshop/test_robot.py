"""The whole mission in virtual time, with bodies; what it has come to, the world says."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import pytest

from tests.support.workshop import needs_world

needs_world()

from bodies import link  # noqa: E402

from mrbt_mesh.testing import Fault, Kill, MissionRun, Restart, run  # noqa: E402
from tests.support.paths import mission_file  # noqa: E402

TIMEOUT_S = 400.0


@pytest.fixture(autouse=True, scope="module")
def _own_import_path() -> Iterator[None]:
    """Loading a program puts its folder on the path, which other tests should not see."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "path", list(sys.path))
        yield


@dataclass(frozen=True)
class Done:
    """A run, and what its world's judge says."""

    run: MissionRun
    judged: dict[str, Any]

    def began(self, local_task: str, robot: str | None = None) -> float:
        """When somebody, or this robot, began it."""
        return next(
            event.at_s
            for event in self.run.starts
            if event.local_task == local_task and robot in (None, event.robot)
        )


def go(*faults: tuple[float, Fault]) -> Done:
    found = run(mission_file("workshop"), faults=faults, timeout_s=TIMEOUT_S)
    (world,) = link.latest
    return Done(found, world.judged())


@pytest.fixture(scope="module")
def undisturbed() -> Done:
    return go()


def test_six_robots_mend_the_vehicle(undisturbed: Done) -> None:
    assert undisturbed.run.result == "success"
    assert undisturbed.run.failures == []
    assert undisturbed.judged["mended"], undisturbed.judged["problems"]
    assert sorted(undisturbed.judged["parts_replaced"]) == ["2", "4"]
    happened = [event["what"] for event in undisturbed.judged["events"]]
    assert happened.index("the cover is off") < happened.index("the cover is on")
    assert sum(what.endswith("is out") for what in happened) == 4
    # All stand still, and those who have nothing to do are at home.
    assert math.dist(undisturbed.judged["robots"]["A1"], (-2, -3)) < 0.5


def test_the_same_seed_is_the_same_run_to_the_byte(undisturbed: Done) -> None:
    again = go()
    assert again.run.whole.effect_log_digest == undisturbed.run.whole.effect_log_digest
    assert json.dumps(again.judged) == json.dumps(undisturbed.judged)


def test_a_robot_that_dies_at_a_part_is_replaced_by_one_that_drives_there(
    undisturbed: Done,
) -> None:
    """It stands where it has died; what it had left, the other one goes on with."""
    began_s = undisturbed.began("replace_hw(2)")
    (dead,) = (e.robot for e in undisturbed.run.starts if e.local_task == "replace_hw(2)")
    ended_s = next(e.at_s for e in undisturbed.run.ends if e.local_task == "replace_hw(2)")
    # Its arm is at the part.
    killed_s = ended_s - 0.8
    assert killed_s > began_s
    done = go((killed_s, Kill(dead)))
    assert done.run.result == "success"
    assert done.judged["mended"], done.judged["problems"]
    (instead,) = done.run.succeeded("replace_hw(2)")
    assert instead != dead
    (mended,) = (e for e in done.judged["events"] if e["what"].startswith("part 2: hardware"))
    assert mended["what"] == f"part 2: hardware done by {instead}"
    # Both bodies are real: the living one worked from beside the dead one.
    where = done.judged["robots"][dead]
    assert 0.7 < math.dist(where, (0.2, -0.4)) < 1.5
    assert all(
        math.dist(where, at) > 0.55 for name, at in done.judged["robots"].items() if name != dead
    )


def test_a_carrier_that_dies_under_the_cover_takes_it_up_again_when_it_is_back(
    undisturbed: Done,
) -> None:
    """Its fork stays up, and the other one waits below its own end."""
    (off,) = (e for e in undisturbed.judged["events"] if e["what"] == "the cover is off")
    killed_s = off["at_s"] - 0.5
    done = go((killed_s, Kill("C2")), (killed_s + 6, Restart("C2")))
    assert done.run.result == "success"
    assert done.judged["mended"], done.judged["problems"]
    assert done.run.cancelled("move_frame(off)") == ["C1"]
    assert sorted(done.run.succeeded("move_frame(off)")) == ["C1", "C2"]
