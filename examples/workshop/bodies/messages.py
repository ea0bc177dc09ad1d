"""What a robot's program and its body say to each other: commands one way, senses the other."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any

# Tools that an arm has at its tip; a type of robot has some of them.
UNSCREW, SCREW = "unscrew", "screw"
PROBE, HARDWARE, WIRES, SOLDER = "probe", "hardware", "wires", "solder"
TOOLS = (UNSCREW, SCREW, PROBE, HARDWARE, WIRES, SOLDER)

RAYS, RANGE_M = 40, 4.0
# More than the fork itself weighs.
LOADED_N = 60.0


class MessageError(ValueError):
    """A message that is none; the text says what would be right."""


@dataclass(frozen=True)
class Command:
    """What a robot wants its motors to do; it holds for a quarter of a second.

    Velocities are in the robot's own frame, in m/s (forward, to the left) and rad/s (to the left).
    `arm_m`: how far the arm is out. `reach_m`, `fork_m`: how far the fork is out, and up; small
    robots have none. `tool`: which one is on, "" for none.
    """

    forward: float = 0.0
    left: float = 0.0
    turn: float = 0.0
    arm_m: float = 0.0
    reach_m: float = 0.0
    fork_m: float = 0.0
    tool: str = ""

    def __post_init__(self) -> None:
        for field in fields(self)[:-1]:
            value = getattr(self, field.name)
            if isinstance(value, bool) or not isinstance(value, int | float):
                raise MessageError(f"{field.name} is a number, not {value!r:.40}")
            if not math.isfinite(value):
                raise MessageError(f"{field.name} is a finite number, not {value!r}")
        if self.tool and self.tool not in TOOLS:
            raise MessageError(f"tool is one of {', '.join(TOOLS)}, not {self.tool!r:.40}")

    @staticmethod
    def read(given: Any) -> Command:
        """Raises MessageError for what is no command."""
        if not isinstance(given, Mapping):
            raise MessageError(f"a command is a mapping, not {type(given).__name__}")
        unknown = set(given) - {field.name for field in fields(Command)}
        if unknown:
            raise MessageError(f"a command has no {', '.join(sorted(map(str, unknown)))}")
        return Command(**given)

    def plain(self) -> dict[str, Any]:
        return asdict(self)


@dataclass(frozen=True)
class AtTip:
    """What a robot's arm has at its tip: a screw, or a part of the vehicle.

    `done`: for a screw 0 (in) to 1 (out); for a part how far hardware, wires and solder are, each 0
    to 1. `reading`: what the probe has measured, good or broken, once it has. `covered`: the cover
    is between the tip and the part.
    """

    name: str
    done: tuple[float, ...]
    reading: str = ""
    covered: bool = False


@dataclass(frozen=True)
class Fork:
    """`tilt_rad`: how far what lies on the fork leans, 0 with nothing on it."""

    up_m: float
    out_m: float
    load_n: float
    tilt_rad: float


@dataclass(frozen=True)
class Senses:
    """What a robot's sensors say: metres, radians, newtons, seconds of the world.

    `ranges_m`: distances to what stands around, the first one straight ahead, then to the left; the
    farthest that it sees is `RANGE_M`. `at_tip`: None for nothing.
    """

    time_s: float
    x: float
    y: float
    heading: float
    forward: float
    left: float
    arm_m: float
    ranges_m: tuple[float, ...]
    at_tip: AtTip | None
    fork: Fork | None

    @property
    def is_loaded(self) -> bool:
        """Whether something lies on the fork."""
        return self.fork is not None and self.fork.load_n > LOADED_N

    @staticmethod
    def read(given: Mapping[str, Any]) -> Senses:
        """The inverse of `plain`."""
        tip, fork = given["at_tip"], given["fork"]
        return Senses(
            **{
                **given,
                "ranges_m": tuple(given["ranges_m"]),
                "at_tip": AtTip(**{**tip, "done": tuple(tip["done"])}) if tip else None,
                "fork": Fork(**fork) if fork else None,
            }
        )

    def plain(self) -> dict[str, Any]:
        return asdict(self)
