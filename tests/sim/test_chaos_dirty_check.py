"""An agent that lets most inputs pass does just what one does that settles after each."""

from dataclasses import replace

import pytest

from mrbt_mesh.core.agent.follow_up import FollowUp
from mrbt_mesh.sim.chaos.campaign import Source
from mrbt_mesh.sim.run import run_scenario
from tests.support.effort import seeds


def effect_log(seed: int) -> list[str]:
    source = Source()
    mission, program = source.load(seed)
    # Plans that are asked for are effects, and there are more of them.
    scenario = replace(source.scenario(seed, mission), plan_delay_us=None)
    return list(run_scenario(mission, program, scenario, keep_log=True).effect_log)


@pytest.mark.parametrize("seed", seeds(8))
def test_what_is_let_pass_would_have_had_no_effect(
    seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    expected = effect_log(seed)
    monkeypatch.setattr(FollowUp, "_is_clean", lambda *_: False)
    assert effect_log(seed) == expected
