"""One chaos run as plain data: what happens when, to whom, over which network. JSON and back."""

from __future__ import annotations

import dataclasses
import json
import math
import types
import typing
from dataclasses import dataclass
from typing import Any

from mrbt_mesh.errors import InputError
from mrbt_mesh.sim.world import faults
from mrbt_mesh.sim.world.network import LinkKnobs, NetworkKnobs

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
        if any(isinstance(fault, faults.EndRouter | faults.StartRouter) for _, fault in self.steps):
            raise ValueError("steps: there are no routers in a schedule, so none can die")

    @property
    def network(self) -> NetworkKnobs:
        return NetworkKnobs(self.link, token_delay_us=self.token_delay_us)

    def with_steps(self, steps: typing.Iterable[Step]) -> Scenario:
        """The same with other faults."""
        return dataclasses.replace(self, steps=tuple(sorted(steps, key=lambda step: step[0])))

    def to_json(self) -> dict[str, Any]:
        data = {f.name: getattr(self, f.name) for f in dataclasses.fields(self)}
        steps = [[at_us, {"fault": type(f).__name__, **_plain(f)}] for at_us, f in self.steps]
        return {**data, "robots": list(self.robots), "link": _plain(self.link), "steps": steps}


def scenario_from_json(data: Any) -> Scenario:
    """The inverse of `to_json`; raises ScenarioError."""
    if not isinstance(data, dict):
        raise ScenarioError("a schedule is an object with seed, robots, steps")
    steps = data.get("steps")
    if not isinstance(steps, list):
        raise ScenarioError("steps: a list of [time_us, fault] is expected")
    values = {**data, "steps": tuple(_step(number, step) for number, step in enumerate(steps))}
    scenario = _build(Scenario, values, "schedule")
    assert isinstance(scenario, Scenario)
    return scenario


def dump(scenario: Scenario, **more: Any) -> str:
    """The text of a schedule file: one line per step, so that people can read and cut it."""
    data = {**more, **scenario.to_json()}
    steps = ",\n".join(f"    {json.dumps(step)}" for step in data.pop("steps"))
    head = json.dumps(data, indent=2).removesuffix("\n}")
    return f'{head},\n  "steps": [\n{steps}\n  ]\n}}\n'


def _step(number: int, step: Any) -> Step:
    where = f"steps[{number}]"
    if not (isinstance(step, list) and len(step) == 2 and isinstance(step[1], dict)):
        raise ScenarioError(f'{where}: [time_us, {{"fault": ...}}] is expected')
    at_us, values = step
    kind = KINDS.get(values.get("fault", ""))
    if kind is None:
        raise ScenarioError(
            f"{where}: no fault {values.get('fault')!r}; there is {', '.join(KINDS)}"
        )
    if type(at_us) is not int or at_us < 0:
        raise ScenarioError(f"{where}: a time in whole microseconds is expected, found {at_us!r}")
    rest = {name: value for name, value in values.items() if name != "fault"}
    return at_us, typing.cast(faults.Fault, _build(kind, rest, where))


def _plain(value: Any) -> Any:
    """A fault or its parts as JSON: sets as sorted lists, defaults left out."""
    if dataclasses.is_dataclass(value):
        return {
            f.name: _plain(getattr(value, f.name))
            for f in dataclasses.fields(value)
            if getattr(value, f.name) != f.default
        }
    if isinstance(value, frozenset):
        return [list(link) for link in sorted(value)]
    return list(value) if isinstance(value, tuple) else value


def _build(kind: type[Any], values: dict[str, Any], where: str) -> Any:
    """An instance of a dataclass from plain data, every field checked against its type."""
    hints = typing.get_type_hints(kind)
    fields = {f.name: f for f in dataclasses.fields(kind)}
    unknown = sorted(values.keys() - fields.keys())
    if unknown:
        raise ScenarioError(f"{where}: {kind.__name__} has no {unknown[0]!r} ({', '.join(fields)})")
    made = {}
    for name, field in fields.items():
        if name in values:
            made[name] = _typed(hints[name], values[name], f"{where}.{name}")
        elif field.default is dataclasses.MISSING:
            raise ScenarioError(f"{where}: {kind.__name__} needs {name!r}")
    try:
        return kind(**made)
    except ValueError as error:
        raise ScenarioError(f"{where}: {error}") from None


def _typed(hint: Any, value: Any, where: str) -> Any:
    if isinstance(hint, types.UnionType):
        if value is None and type(None) in hint.__args__:
            return None
        hint = next(part for part in hint.__args__ if part is not type(None))
    origin = typing.get_origin(hint)
    if dataclasses.is_dataclass(hint) and isinstance(hint, type):
        if isinstance(value, dict):
            return _build(hint, value, where)
    elif origin is frozenset:
        if isinstance(value, list) and all(_is_pair(link) for link in value):
            return frozenset((source, target) for source, target in value)
    elif origin is tuple:
        if isinstance(value, list | tuple):
            return tuple(value)
    elif hint is float and type(value) in (int, float):
        return float(value)
    elif hint is Any or type(value) is hint:
        return value
    raise ScenarioError(f"{where}: {value!r} is not what is expected here ({hint})")


def _is_pair(link: Any) -> bool:
    return isinstance(link, list) and len(link) == 2 and all(isinstance(x, str) for x in link)
