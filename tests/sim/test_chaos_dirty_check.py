"""An agent that lets most inputs pass does just what one does that settles after each."""

import random
from dataclasses import replace

import pytest

from mrbt_mesh.core.agent.agent import Agent
from mrbt_mesh.formats.mission_file import load_mission
from mrbt_mesh.runtime.program_loader import load_program
from mrbt_mesh.sim import (
    Fault,
    Freeze,
    Kill,
    LinkKnobs,
    NetworkKnobs,
    Restart,
    Thaw,
    simulate,
)
from mrbt_mesh.sim.chaos.campaign import Source
from mrbt_mesh.sim.run import run_scenario
from tests.support.effort import seeds
from tests.support.paths import EXAMPLES

SECOND_US = 1_000_000


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
    monkeypatch.setattr(Agent, "_is_clean", lambda *_: False)
    assert effect_log(seed) == expected


def large_team_log(seed: int) -> list[str]:
    """Ten robots in a ring: some die, freeze and come back, and messages are lost."""
    mission = load_mission(EXAMPLES / "vehicle_repair" / "mission.yaml")
    copies = {f"{name}-2": replace(mission.robots[name], id=f"{name}-2") for name in mission.robots}
    mission = replace(mission, robots=dict(sorted({**mission.robots, **copies}.items())[:10]))
    assert mission.program is not None
    choose = random.Random(seed)
    schedule: list[tuple[int, Fault]] = []
    for robot in choose.sample(sorted(mission.robots), 3):
        at_us = choose.randrange(8 * SECOND_US)
        faults: tuple[Fault, Fault] = (Kill(robot), Restart(robot))
        if choose.random() < 0.5:
            faults = (Freeze(robot), Thaw(robot))
        back_us = at_us + choose.randrange(SECOND_US, 6 * SECOND_US)
        schedule += [(at_us, faults[0]), (back_us, faults[1])]
    link = LinkKnobs(delay_us=1_000, jitter_us=100_000, loss_permille=200)
    result = simulate(
        mission,
        load_program(mission.program),
        seed=seed,
        schedule=sorted(schedule, key=lambda step: step[0]),
        network=NetworkKnobs(link=link, token_delay_us=choose.choice((None, 5_000))),
        timeout_us=15 * SECOND_US,
        speed=4.0,
        keep_log=True,
    )
    assert result.violations == []
    return list(result.effect_log)


@pytest.mark.slow
@pytest.mark.parametrize("seed", seeds(5))
def test_the_same_in_a_ring(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    expected = large_team_log(seed)
    monkeypatch.setattr(Agent, "_is_clean", lambda *_: False)
    assert large_team_log(seed) == expected
