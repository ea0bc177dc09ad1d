"""One chaos run as plain data: what happens when, to whom, over which network. JSON and back."""

from __future__ import annotations

import dataclasses
import json
import math
import sys
import typing
from dataclasses import dataclass
from typing import Any

from mrbt_mesh.core.codec import Codec, DataError, StandIn
from mrbt_mesh.errors import InputError
from mrbt_mesh.sim.world import faults
from mrbt_mesh.sim.world.network import Link, LinkKnobs, NetworkKnobs

_BASES = (faults.Fault, faults.RobotFault)
KINDS: dict[str, type[faults.Fault]] = {
    name: kind
    for name, kind in vars(faults).items()
    if isinstance(kind, type) and issubclass(kind, faults.Fault) and kind not in _BASES
}
Step: typing.TypeAlias = tuple[int, faults.Fault]


USUAL = LinkKnobs()


class ScenarioError(InputError):
    """A schedule file that cannot be used; the message names what is expected."""


@dataclass(frozen=True)
class Scenario:
    """`robots` are launched at the start; `steps` are the faults, sorted by time, in microseconds.

    From `heal_us` on nothing breaks any more (the last step is a `Heal`), and the team must
    converge and finish what can be finished. `links` is how all links usually behave,
    `token_delay_us` as in NetworkKnobs. `stays`: robots do not stop when the mission is over.
    `plan_delay_us` as in `simulate`. Raises ValueError for what cannot be run.
    """

    seed: int
    robots: tuple[str, ...]
    steps: tuple[Step, ...]
    heal_us: int
    timeout_us: int
    link: LinkKnobs = USUAL
    token_delay_us: int | None = 5_000
    speed: float = 1.0
    stays: bool = False
    plan_delay_us: int | None = None

    def __post_init__(self) -> None:
        if not self.robots or len(set(self.robots)) < len(self.robots):
            raise ValueError("robots: at least one is expected, and none twice")
        if not 0 < self.speed < math.inf:
            raise ValueError(f"speed: a number above 0 is expected, found {self.speed}")
        if self.timeout_us <= 0 or min(self.heal_us, self.plan_delay_us or 0) < 0:
            raise ValueError("timeout_us is above 0, heal_us and plan_delay_us are not below 0")
        for number, (at_us, _) in enumerate(self.steps):
            if at_us < 0:
                raise ValueError(
                    f"steps.{number}.0: a time from 0 us on is expected, found {at_us}"
                )
        if any(isinstance(fault, faults.EndRouter | faults.StartRouter) for _, fault in self.steps):
            raise ValueError("steps: there are no routers in a schedule, so none can die")

    @property
    def network(self) -> NetworkKnobs:
        return NetworkKnobs(self.link, token_delay_us=self.token_delay_us)

    def with_steps(self, steps: typing.Iterable[Step]) -> Scenario:
        """The same with other faults."""
        return dataclasses.replace(self, steps=tuple(sorted(steps, key=lambda step: step[0])))

    def to_json(self) -> dict[str, Any]:
        data: dict[str, Any] = _CODEC.write(Scenario, self)
        return data


def scenario_from_json(data: Any) -> Scenario:
    """The inverse of `to_json`; raises ScenarioError."""
    try:
        scenario: Scenario = _CODEC.read(Scenario, data)
    except ValueError as error:
        raise ScenarioError(f"schedule: {error}") from None
    return scenario


def dump(scenario: Scenario, **more: Any) -> str:
    """The text of a schedule file: one line per step, so that people can read and cut it."""
    data = {**more, **scenario.to_json()}
    steps = ",\n".join(f"    {json.dumps(step)}" for step in data.pop("steps"))
    head = json.dumps(data, indent=2).removesuffix("\n}")
    return f'{head},\n  "steps": [\n{steps}\n  ]\n}}\n'


def _fault_to_json(fault: faults.Fault) -> dict[str, Any]:
    return {"fault": type(fault).__name__, **_CODEC.write(type(fault), fault)}


def _fault_from_json(data: Any) -> faults.Fault:
    name = data.get("fault") if isinstance(data, dict) else None
    if not isinstance(name, str) or name not in KINDS:
        raise ValueError(f"no fault {name!r:.80}; there is {', '.join(KINDS)}")
    rest = {field: value for field, value in data.items() if field != "fault"}
    try:
        fault: faults.Fault = _CODEC.read(KINDS[name], rest)
    except DataError as error:
        raise error.below(name) from None
    return fault


def _number(found: Any) -> float:
    if type(found) not in (int, float) or not abs(found) <= sys.float_info.max:
        raise ValueError(f"a number expected, not {found!r:.80}")
    return float(found)


_CODEC = Codec(
    {
        float: StandIn(Any, lambda number: number, _number),
        frozenset[Link]: StandIn(tuple[Link, ...], sorted, frozenset),
        faults.Fault: StandIn(Any, _fault_to_json, _fault_from_json),
    }
)
