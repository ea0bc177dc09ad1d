"""What a run's record says at a moment, in a few lines."""

from __future__ import annotations

import math

from mrbt_mesh.observer.run_record import RunRecord
from paper.scene import Part, Scene


def seconds(record: RunRecord, at_us: int) -> str:
    """A moment as `13.06 s`, from the first robot's joining on, as in a run's summary."""
    at_s = record.seconds(at_us)
    assert at_s is not None, "nobody has joined"
    return f"{at_s:.2f} s"


def caption(scene: Scene, record: RunRecord) -> list[str]:
    """Who works on what and who rests; the parts; the faults that the team knows of."""
    work: dict[str, list[str]] = {}
    for robot, span in sorted(scene.work.items()):
        task = span.ground if span.part else f"{span.ground} for {span.global_task}"
        work.setdefault(task, []).append(robot)
    at_work = [f"{all_of(robots)} {task}" for task, robots in work.items()]
    resting = f"at rest {all_of(scene.resting)}" if scene.resting else ""
    faults = _faults(scene, record)
    return [
        f"{seconds(record, scene.at_us)}: {'; '.join(filter(None, [*at_work, resting]))}.",
        f"Parts: {_parts(scene)}.",
        f"Faults: {'; '.join(faults) if faults else 'none'}.",
    ]


def _parts(scene: Scene) -> str:
    found: dict[Part, list[str]] = {}
    for part, state in scene.parts.items():
        found.setdefault(state, []).append(part)
    return "; ".join(f"{all_of(found[state])} {state}" for state in Part if state in found)


def _faults(scene: Scene, record: RunRecord) -> list[str]:
    lines = []
    for robot, fault in scene.dead.items():
        text = f"{robot} dead since {seconds(record, fault.at_us)}"
        if fault.held is not None:
            text += f", it held {fault.held.local_task}"
        if fault.reassigned_us is not None and fault.reassigned_us <= scene.at_us:
            within_ms = 10 * max(1, math.ceil((fault.reassigned_us - fault.at_us) / 10_000))
            text += f", which {fault.replacement} started within {within_ms} ms"
        lines.append(text)
    for lost in scene.lost:
        since = seconds(record, lost.at_us)
        lines.append(f"{lost.robot} has lost {', '.join(lost.local_tasks)} since {since}")
    return lines


def all_of(names: list[str]) -> str:
    """`A1`, `A1 and A2`, `A1, A2 and B1`."""
    *most, last = names
    return f"{', '.join(most)} and {last}" if most else last
