"""A recorded run beside its simulated continuation, as data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from mrbt_mesh.cli.command import FAILURE, fail
from mrbt_mesh.cli.options import checked_program
from mrbt_mesh.cli.virtual.named_faults import read_faults
from mrbt_mesh.core.membership.timing import SECOND_US
from mrbt_mesh.errors import InputError
from mrbt_mesh.recording.player import Player
from mrbt_mesh.recording.reader import open_recording
from mrbt_mesh.runtime.program_loader import load_program
from mrbt_mesh.sim.run import SimulationError
from mrbt_mesh.views.recordings.showing import time_of
from mrbt_mesh.views.replay.what_if import ASSUMED, what_if


def continued(
    file: Path,
    at_s: float,
    faults: Mapping[str, Sequence[str]],
    without_recorded: bool,
    program: str | None,
    seed: int,
    timeout_s: float,
) -> dict[str, Any]:
    """Return both summaries, and the assumptions. Raises InputError for options that do not fit."""
    recording = open_recording(file)
    player = Player(recording)
    at_us = time_of(player, at_s)
    named = read_faults(
        player.mission, {f"--{kind}": texts for kind, texts in faults.items()}, at_s
    )
    for each in named:
        if each.at_us < round(at_s * SECOND_US):
            raise InputError(f"{each.said}: before --at {at_s:g}, when it goes on")
    try:
        found = what_if(
            recording,
            at_us,
            load_program(checked_program(player.mission, sorted(player.mission.robots), program)),
            [(player.begin_us + each.at_us, each.fault) for each in named],
            without_recorded=without_recorded,
            seed=seed,
            timeout_us=round(timeout_s * SECOND_US),
        )
    except SimulationError as error:
        fail(str(error), FAILURE)
    except ValueError as error:
        raise InputError(str(error)) from None
    ended_us = found.result.observer.record.ended_us

    def over_at_s(at_us: int | None) -> float | None:
        return None if at_us is None else (at_us - player.begin_us) / SECOND_US

    return {
        "at_s": at_s,
        "faults": [each.said for each in named],
        "without_recorded_faults": without_recorded,
        "assumed": [*ASSUMED, *([f"the recording: {recording.torn}"] if recording.torn else [])],
        "under_way": found.under_way,
        "recorded": {
            **found.recorded.summary(),
            "over_at_s": over_at_s(found.recorded.observer.record.ended_us),
        },
        "what_if": {
            **found.result.summary,
            "over_at_s": over_at_s(None if ended_us is None else found.recorded_us(ended_us)),
        },
    }
