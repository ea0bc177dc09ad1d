"""Options and arguments that several commands take, each defined once."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from mrbt_mesh.cli.framework.declare import argument, option

MissionArgument = Annotated[Path, argument("MISSION", "Mission file (.yaml).")]
OptionalMissionArgument = Annotated[Path | None, argument("MISSION", "Mission file (.yaml).")]
TreeFileArgument = Annotated[
    Path, argument("FILE", "BehaviorTree.CPP file (.xml) or mission (.yaml).")
]
RobotArgument = Annotated[str, argument("ROBOT", "A robot's id.")]

JsonOption = Annotated[bool, option("Print one JSON object.", name="--json")]
RunDirOption = Annotated[
    Path | None, option("Run directory. Default: the run started last.", "DIR")
]

# -- how a mission is run -------------------------------------------------------------------

RobotsOption = Annotated[str | None, option("Only these robots. Default: all.", "A1,A2,...")]
ProgramOption = Annotated[
    str | None, option("The robots' program. Default: the mission's.", "FILE.py[:NAME]")
]
SolverOption = Annotated[
    str | None,
    option(
        "min_cost_flow, cp_sat, brute_force, or your own: docs/solvers.md. Default: the mission's.",
        "NAME",
    ),
]
SpeedOption = Annotated[
    float, option("Simulated robots work this many times faster.", least=0.01, most=1000)
]

# -- what is recorded -----------------------------------------------------------------------

RecordBeatsOption = Annotated[bool, option("Record every heartbeat as well.")]
KeepOption = Annotated[
    int,
    option(
        "Size at which a robot's log, output and events begin anew, each with the one before "
        "kept, and at which its recording ends.",
        "MIB",
        least=1,
        most=1_000_000,
    ),
]

# -- in virtual time ------------------------------------------------------------------------

SeedOption = Annotated[int, option("The same seed gives the same result.", least=0)]
VirtualTimeoutOption = Annotated[
    float,
    option(
        "Virtual seconds until a run is given up.",
        "SECONDS",
        name="--timeout",
        least=0.001,
    ),
]
JobsOption = Annotated[
    int | None, option("In so many processes. Default: all cores.", least=1, most=1024)
]
