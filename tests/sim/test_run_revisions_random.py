"""Random revisions of teams with open, held, running and ended jobs, places and deaths, against the
rules of docs/how-to/revise.md (`tests.support.revision_model`).
"""

from __future__ import annotations

import copy
import random
from dataclasses import dataclass, field
from pathlib import Path

import anyio
import pytest

from mrbt_mesh import TaskContext
from mrbt_mesh.core.bt.activation import parse_activation
from mrbt_mesh.core.mission.compiled import compile_mission
from mrbt_mesh.core.mission.jobs import type_at
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.errors import FileError
from mrbt_mesh.features.revisions import changes
from mrbt_mesh.features.revisions import revise as numbering
from mrbt_mesh.features.revisions.section import revision_of
from mrbt_mesh.formats.build import mission_from_yaml
from mrbt_mesh.observer.run_record import RunRecord
from mrbt_mesh.runtime.program import RobotProgram
from mrbt_mesh.sim import Fault, Kill, Restart, SimulationResult, simulate
from mrbt_mesh.sim.world.faults import Operate, Revise
from tests.support.effort import at_size
from tests.support.revision_files import File, changed, guarded, random_file, text_of
from tests.support.revision_model import TEAM, FileJob, Identities, may_have

S = 1_000_000
SECONDS = 60
# Work that a revision cancels may end all the same, and be told, for so long.
CANCELLED_S = 0.5


@dataclass
class Story:
    """One run: the files by version, what happens, and what comes of it."""

    seed: int
    files: list[File] = field(default_factory=list)
    missions: list[Mission] = field(default_factory=list)
    jobs: dict[str, FileJob] = field(default_factory=dict)
    faults: list[tuple[float, Fault]] = field(default_factory=list)
    deaths_s: list[float] = field(default_factory=list)
    proposed_s: list[tuple[float, int]] = field(default_factory=list)


def story_of(seed: int) -> Story:
    pick = random.Random(f"revisions/{seed}")
    story = Story(seed)
    first, is_there_and_back = random_file(pick), pick.random() < 0.3
    if is_there_and_back:
        for task in first["global_tasks"].values():
            task["exclusive"] = pick.random() < 0.4
    add(story, first, pick)
    robots = sorted(first["robots"])
    for number in range(pick.randint(2, 6)):
        kind = pick.choice(sorted(first["jobs"]))
        ((_, values),) = first["jobs"][kind]["parameters"].items()
        argument = pick.choice(sorted(first["travel"]["places"]) if values == "place" else values)
        job = FileJob(f"job-{number}", kind, argument)
        story.jobs[job.id] = job
        value = [kind, [argument], 0, 0, 0, number]
        at_s, robot = pick.uniform(3, 14), pick.choice(robots)
        story.faults.append((at_s, Operate(robot, f"job/{job.id}", value)))
        if pick.random() < 0.3:
            for more_s, hold in ((0.01, "held"), (25 - at_s, "released")):
                change = Operate(robot, f"job_hold/{job.id}", hold)
                story.faults.append((at_s + more_s, change))
    for number in range(2 if is_there_and_back else pick.randint(1, 3)):
        before = story.files[-1] if pick.random() < 0.7 else pick.choice(story.files)
        if is_there_and_back:
            after = guarded(first, pick) if not number else copy.deepcopy(first)
        else:
            is_back = number and pick.random() < 0.3
            after = copy.deepcopy(story.files[-2]) if is_back else changed(before, pick)
        version = add(story, after, pick)
        at_s = (3.0 + 9 * number if is_there_and_back else 6.0 + 5 * number) + pick.uniform(0, 4)
        text = compile_mission(story.missions[version])
        story.proposed_s.append((at_s, version))
        is_forced = pick.random() < 0.7
        story.faults.append((at_s, Revise(pick.choice(robots), text, is_forced)))
    if pick.random() < 0.3:
        at_s, robot = pick.uniform(4, 20), pick.choice(robots)
        story.faults += [(at_s, Kill(robot)), (at_s + 6, Restart(robot))]
        story.deaths_s += [at_s, at_s + 6]
    return story


def add(story: Story, file: File, pick: random.Random) -> int:
    """Add a file, if it is one; its version."""
    file["parameters"] = {"version": len(story.files)}
    try:
        mission = mission_from_yaml(text_of(file, pick), f"{story.seed}.yaml", Path())
    except FileError:
        return len(story.files) - 1
    story.files.append(file)
    story.missions.append(mission)
    return len(story.files) - 1


async def work(task: TaskContext, *_: str) -> None:
    await anyio.sleep(task.simulation.duration_s)


async def drive(task: TaskContext, _: str) -> None:
    await anyio.sleep(0.5)


def run(story: Story, monkeypatch: pytest.MonkeyPatch, inspect: bool = False) -> list[str]:
    """What is wrong with the run."""
    program = RobotProgram(record_work=True)
    program.local_task("*")(work)
    program.travel(drive)
    in_force: list[tuple[float, int]] = []
    revise_record = RunRecord.revised

    def noted(record: RunRecord, mission: Mission, now_us: int) -> None:
        in_force.append((now_us / S, mission.parameters["version"]))
        revise_record(record, mission, now_us)

    monkeypatch.setattr(RunRecord, "revised", noted)
    result = simulate(
        story.missions[0],
        program,
        seed=story.seed,
        schedule=[(round(at_s * S), fault) for at_s, fault in sorted(story.faults, key=by_time)],
        timeout_us=SECONDS * S,
        inspect=inspect,
    )
    return problems(story, result, in_force)


def by_time(step: tuple[float, Fault]) -> float:
    return step[0]


def problems(
    story: Story, result: SimulationResult, in_force: list[tuple[float, int]]
) -> list[str]:
    model, found = Identities(), [f"invariant: {each}" for each in result.violations]
    model.take_up(story.files[0])
    jobs = {**story.jobs, "": TEAM}
    ended: set[str] = set()
    submitted_s: dict[str, float] = {}
    happened = [(at_s, 0, version, None) for at_s, version in in_force]
    happened += [
        (at_s, 2, 0, {"id": fault.name.partition("/")[2]})
        for at_s, fault in story.faults
        if isinstance(fault, Operate) and fault.name.startswith("job/")
    ]
    happened += [
        (float(each["t"]), 1, 0, each)
        for each in result.events
        if (each.get("event"), each.get("outcome")) in (("begin", None), ("end", "success"))
        or each.get("event") == "start"
    ]
    last_s, file = -10.0, story.files[0]
    for at_s, what, version, event in sorted(happened, key=lambda each: each[:2]):
        if what == 2:
            is_dead = bool(story.deaths_s) and story.deaths_s[0] < at_s < story.deaths_s[1] + 3
            if may_have(file, jobs[event["id"]]) and not is_dead:
                submitted_s[event["id"]] = at_s
        elif event is None:
            file, last_s = story.files[version], at_s
            still = [job for job in jobs.values() if job.id not in ended]
            # A job that arrives while a revision is proposed may be refused.
            found += [
                f"{at_s}: version {version} has no place for {job}"
                for job in still
                if submitted_s.get(job.id, at_s) < at_s - 1 and not may_have(file, job)
            ]
            found += [f"{at_s}: repeats {x}" for x in model.repeated_by(file, still)]
            model.take_up(file)
        else:
            job = jobs[parse_activation(event["activation"]).job]
            call = f"{event['local_task']}"
            if "(" not in call and event["args"]:
                call += f"({','.join(event['args'])})"
            is_excused = at_s < last_s + CANCELLED_S or any(
                abs(at_s - death_s) < 8 for death_s in story.deaths_s
            )
            if event["event"] == "end":
                if not model.finish(job, call) and not is_excused:
                    found.append(f"{at_s}: {call} of {job.id or 'the team'} is done again")
            elif job.id in ended and job != TEAM and not is_excused:
                found.append(f"{at_s}: {call} of {job.id} begins, which has ended")
        for job in jobs.values():
            begun = any(count for (_, name), count in model.done.items() if name == job.id)
            if job != TEAM and begun and not model.missing(job):
                ended.add(job.id)
    if not story.deaths_s:
        found += unfinished(story, result, model, ended)
    return found


def unfinished(
    story: Story, result: SimulationResult, model: Identities, ended: set[str]
) -> list[str]:
    """Jobs and steps of the team that are not done in the end."""
    facts = next(iter(result.agents.values())).view.facts
    found = [f"the team has not done {name}" for name in model.missing(TEAM)]
    for job in story.jobs.values():
        known = facts.jobs.known.get(job.id) if facts.jobs is not None else None
        if known is None:
            if all(may_have(file, job) for file in story.files):
                found.append(f"{job} is not known")
        elif (known.end is not None) != (job.id in ended):
            state = known.end.state if known.end is not None else "open"
            found.append(f"{job} is {state}, and lacks {model.missing(job)}")
    return found


@pytest.mark.parametrize("seed", at_size(quick=range(10), gate=range(250)))
def test_a_random_revision_keeps_what_the_guide_says(
    seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two revisions on average. The invariants are looked at in every tenth run."""
    found = run(story_of(seed), monkeypatch, inspect=seed % 10 == 0)
    assert not found, (seed, found)


def only_steps_that_were_never_known(steps: changes._Steps, step: changes._Step) -> list[int]:
    known = revision_of(steps._facts.in_force)
    first = len(steps._facts.in_force.tree.nodes) if known is None else known.next_node
    return [number for number in steps._now[step] if number >= first]


def declared_values_count(parts: numbering._Parts, index: int) -> str:
    kind = type_at(parts._mission, index)
    return repr(kind and (kind.name, kind.parameters))


def test_a_deliberate_bug_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    """Steps count as others if the type declares other values."""
    monkeypatch.setattr(numbering._Parts, "_type_name", declared_values_count)
    assert any(run(story_of(seed), monkeypatch) for seed in (0, 10))


def test_steps_that_never_began_must_be_looked_at(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(changes._Steps, "_fresh_numbers", only_steps_that_were_never_known)
    assert any(run(story_of(seed), monkeypatch) for seed in (1, 22))
