"""The metadata of a recording: its robot, run and mission."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, fields
from functools import cache
from typing import Any, NamedTuple, get_type_hints

from mrbt_mesh.core.codec import Codec, StandIn
from mrbt_mesh.core.membership.timing import Timing
from mrbt_mesh.core.mission.compiled import compile_mission, mission_from_compiled
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.recording.channels import FORMAT

# Replaces the robot's name in the recording of an observer.
OBSERVER = ""


class NamedRecording(NamedTuple):
    """What another file says of a recording: at that time its last message had this number and
    check.

    The check is in hexadecimal. `name`: the file of its first part. `is_finished`: its writer had
    ended, so nothing follows that message.
    """

    name: str
    number: int
    check: str
    is_finished: bool = False


def pack_named(named: Iterable[NamedRecording]) -> list[list[str | int | bool]]:
    """Return named recordings as JSON lists; files of earlier versions do not have the last
    column.
    """
    return [[*each] if each.is_finished else [*each[:3]] for each in named]


def parse_named(data: Iterable[Iterable[Any]]) -> tuple[NamedRecording, ...]:
    """The inverse of `pack_named`. Raises ValueError or TypeError."""
    return tuple(_named(*row) for row in data)


def _named(name: Any, number: Any, check: Any, is_finished: Any = False) -> NamedRecording:
    if type(is_finished) is not bool:
        raise ValueError(f"{name}: is finished, or is not")
    return NamedRecording(str(name), int(number), str(check), is_finished)


@dataclass(frozen=True)
class RunMetadata:
    """The metadata of a recording.

    `robot` is empty for an observer's recording; `mission` is the compiled mission's text.
    `epoch_ns`: the Unix time at which the clock of the recording's owner was 0, as it was when the
    recording began; `clock`: which clock that is, empty if it is not known. `has_keys`: facts are
    signed. `solver`: the robot's own choice, empty for the mission's. `speed`: how many times
    faster simulated robots work. `is_observed`: the launcher of the robots records their run too.
    `has_summary`: this is that recording, and its observer writes summary.json at its end.
    `earlier`: the recordings that existed when this one began: its owner's earlier ones, and for an
    observer also those of the robots.

    A long recording has several parts: `part` is the number of this one, `after_number` and
    `after_check` are those of the last message of the part before, and `kept_from` was the first
    part that was kept when this one began.
    """

    robot: str
    run: str
    mission: str
    mission_digest: str
    timing: Timing
    epoch_ns: int
    version: str
    solver: str = ""
    has_keys: bool = False
    speed: float = 1.0
    part: int = 1
    after_number: int = 0
    after_check: str = ""
    kept_from: int = 1
    is_observed: bool = False
    has_summary: bool = False
    clock: str = ""
    # Last, because its text is not empty: a reader takes zeros at the end of a file for what was
    # never written.
    earlier: tuple[NamedRecording, ...] = ()

    @property
    def team_digest(self) -> str:
        """The digest of the mission with which the team was started. Raises FileError for a damaged
        mission.
        """
        return mission_from_compiled(self.mission, "metadata").team_digest

    @staticmethod
    def of(
        mission: Mission, robot: str, run: str, timing: Timing, epoch_ns: int, version: str
    ) -> RunMetadata:
        """Return the metadata of a run without keys, with the mission's solver."""
        return RunMetadata(
            robot, run, compile_mission(mission), mission.digest, timing, epoch_ns, version
        )

    def to_values(self) -> dict[str, str]:
        """Return the metadata as MCAP stores it: only texts."""
        texts = {name: _TEXTS.write(hint, getattr(self, name)) for name, hint in _fields()}
        return {"format": FORMAT, **texts}

    @staticmethod
    def from_values(values: Mapping[str, str]) -> RunMetadata:
        """Parse the result of `to_values`. Raises ValueError for anything else."""
        if values.get("format") != FORMAT:
            found = values.get("format", "none")
            raise ValueError(f"its format is {found}, this version of mrbt reads {FORMAT}")
        try:
            return RunMetadata(
                **{name: _TEXTS.read(hint, values[name]) for name, hint in _fields()}
            )
        except (ValueError, KeyError, TypeError, OverflowError, RecursionError):
            text = "its metadata are damaged: a field is missing or of another kind"
            raise ValueError(text) from None

    def read_mission(self, file: str) -> Mission:
        """Return the mission.

        Raises FileError for a damaged text, ValueError for another mission's.
        """
        mission = mission_from_compiled(self.mission, file)
        if mission.digest != self.mission_digest:
            raise ValueError("the mission in its metadata is not that of its digest")
        return mission


@cache
def _fields() -> tuple[tuple[str, Any], ...]:
    """The names and types of the fields of metadata, in order."""
    return tuple(get_type_hints(RunMetadata).items())


def _read_timing(text: str) -> Timing:
    found = json.loads(text)
    return Timing(**{each.name: int(found[each.name]) for each in fields(Timing)})


def _read_speed(text: str) -> float:
    speed = float(text)
    if not 0 < speed < math.inf:
        raise ValueError(f"a speed above 0 expected, not {text}")
    return speed


_TEXTS = Codec(
    {
        bool: StandIn(str, json.dumps, {"true": True, "false": False}.__getitem__),
        int: StandIn(str, str, int),
        float: StandIn(str, repr, _read_speed),
        Timing: StandIn(str, lambda timing: json.dumps(asdict(timing)), _read_timing),
        tuple[NamedRecording, ...]: StandIn(
            str,
            lambda earlier: json.dumps(pack_named(earlier)),
            lambda text: parse_named(json.loads(text)),
        ),
    }
)
