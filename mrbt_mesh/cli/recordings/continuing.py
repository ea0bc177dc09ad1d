"""What happened beside what would have happened, as data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from mrbt_mesh.cli.command import FAILURE, fail
from mrbt_mesh.cli.options import checked_program
from mrbt_mesh.cli.recordings.replaying import time_of
from mrbt_mesh.cli.virtual.named_faults import read_faults
from mrbt_mesh.core.membership.timing import SECOND_US
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.errors import InputError
from mrbt_mesh.recording.player import Player
from mrbt_mesh.recording.reader import read_recording
from mrbt_mesh.runtime.program_loader import load_program
from mrbt_mesh.sim.run import SimulationError
from mrbt_mesh.sim.world.named_faults import NamedFault
from mrbt_mesh.views.replay.what_if import ASSUMED, Continuation, what_if


def continued(
    file: Path,
    at_s: float,
    faults: Mapping[str, Sequence[str]],
    program: str | None,
    seed: int,
    timeout_s: float,
) -> dict[str, Any]:
    """Both summaries, and what was assumed. Raises InputError for what does not fit together."""
    recording = read_recording(file)
    player = Player(recording)
    at_us = time_of(player, at_s)
    named = named_faults(player.mission, faults, at_s)
    player.seek(player.end_us)
    try:
        found = what_if(
            recording,
            at_us,
            load_program(checked_program(player.mission, sorted(player.mission.robots), program)),
            [(player.begin_us + each.at_us, each.fault) for each in named],
            seed=seed,
            timeout_us=round(timeout_s * SECOND_US),
        )
    except SimulationError as error:
        fail(str(error), FAILURE)
    except ValueError as error:
        raise InputError(str(error)) from None
    return {
        "at_s": at_s,
        "faults": [each.said for each in named],
        "assumed": list(ASSUMED),
        "under_way": found.under_way,
        "recorded": {
            **player.summary(),
            "over_at_s": _over_at_s(player.observer.record.ended_us, player.begin_us),
        },
        "what_if": {
            **found.result.summary,
            "over_at_s": _simulated_over_at_s(found, player.begin_us),
        },
    }


def named_faults(
    mission: Mission, given: Mapping[str, Sequence[str]], at_s: float
) -> list[NamedFault]:
    """Faults as `mrbt sim run` has them; those without a time come at `at_s`. Raises InputError."""
    options = {
        f"--{kind}": [
            part if "@" in part else f"{part}@{at_s:.6f}" for text in texts for part in _parts(text)
        ]
        for kind, texts in given.items()
    }
    named = read_faults(mission, options)
    for each in named:
        if each.at_us < round(at_s * SECOND_US):
            raise InputError(f"{each.said}: before --at {at_s:g}, when it goes on")
    return named


def _parts(text: str) -> list[str]:
    """A list of faults, cut at commas that are not between the arguments of a local task."""
    parts, depth = [""], 0
    for letter in text:
        depth += (letter == "(") - (letter == ")")
        if letter == "," and not depth:
            parts.append("")
        else:
            parts[-1] += letter
    return parts


def _over_at_s(ended_us: int | None, begin_us: int) -> float | None:
    return None if ended_us is None else (ended_us - begin_us) / SECOND_US


def _simulated_over_at_s(found: Continuation, begin_us: int) -> float | None:
    ended_us = found.result.observer.record.ended_us
    return None if ended_us is None else (found.recorded_us(ended_us) - begin_us) / SECOND_US
