"""`mrbt what-if`."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated

from mrbt_mesh.cli.framework.declare import argument, option
from mrbt_mesh.cli.options import JsonOption, ProgramOption, SeedOption, VirtualTimeoutOption

_fault = partial(option, panel="What befalls the team")
Faults = tuple[str, ...]


@dataclass(frozen=True)
class OtherFaults:
    """What happens to which robot; without @SECONDS at the time at which it goes on."""

    kill: Annotated[Faults, _fault("SIGKILL; repeat it, or use commas.", "A1[@12.5],...")] = ()
    restart: Annotated[Faults, _fault("Start it again, or one more.", "A1[@14],...")] = ()
    freeze: Annotated[Faults, _fault("SIGSTOP.", "A1[@3],...")] = ()
    thaw: Annotated[Faults, _fault("SIGCONT.", "A1[@8],...")] = ()
    leave: Annotated[Faults, _fault("Leave on purpose.", "B1[@6],...")] = ()
    lose: Annotated[
        Faults, _fault("Lose a capability, or all of them.", "A1:LOCAL_TASK[@4],...")
    ] = ()
    restore: Annotated[Faults, _fault("Have it again.", "A1[:LOCAL_TASK][@6],...")] = ()


def what_if(
    file: Annotated[Path, argument("FILE.mcap", "A recording.")],
    at: Annotated[
        float,
        option("Go on from there, in seconds from the recording's begin.", "SECONDS", least=0),
    ],
    faults: OtherFaults,
    program: ProgramOption = None,
    seed: SeedOption = 0,
    timeout: VirtualTimeoutOption = 600.0,
    as_json: JsonOption = False,
) -> None:
    """Go on from a moment of a recorded run in the simulator, with faults that did not happen.

    Facts, alive robots and lost capabilities are those of that moment; what is assumed is told. All
    times count from the begin of the recording.

    Exit status: 0 the mission would have succeeded, 1 failed, 2 bad input, 3 not be finished.

    Example: mrbt what-if run.mcap --at 12 --kill B1; mrbt what-if run.mcap --at 12 --lose
    B1:replace_hw --restore B1@20
    """
    from mrbt_mesh.cli.framework.exits import EXIT_OF_RESULT
    from mrbt_mesh.cli.framework.terminal import console, print_json
    from mrbt_mesh.cli.recordings.continuing import continued
    from mrbt_mesh.cli.views.what_if_view import render_what_if

    data = continued(file, at, vars(faults), program, seed, timeout)
    if as_json:
        print_json(data)
    else:
        console.print(render_what_if(data))
    raise SystemExit(EXIT_OF_RESULT[data["what_if"]["result"]])
