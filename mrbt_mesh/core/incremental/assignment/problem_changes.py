"""What is different between one assignment problem and the next."""

from __future__ import annotations

from dataclasses import dataclass, field
from operator import lt

from mrbt_mesh.core.assignment.named import NamedDemand, NamedProblem


@dataclass(slots=True)
class ProblemChanges:
    """To be made together.

    `new_robots` with what they can do of all demands, the new ones too; candidates of
    `new_demands` that are new robots or not in the team do not count. `order`: the ids of all
    demands as they are afterwards, if some are new. `bounds`: (lower, upper). `cells`: robot ->
    demand -> performance, None for "cannot", of those that both stay.
    """

    gone_robots: list[str] = field(default_factory=list)
    new_robots: dict[str, dict[str, int]] = field(default_factory=dict)
    gone_demands: list[str] = field(default_factory=list)
    new_demands: list[NamedDemand] = field(default_factory=list)
    order: list[str] = field(default_factory=list)
    bounds: dict[str, tuple[int, int]] = field(default_factory=dict)
    cells: dict[str, dict[str, int | None]] = field(default_factory=dict)

    def __len__(self) -> int:
        """How many single changes; each may move a few robots."""
        robots = len(self.gone_robots) + len(self.new_robots) + len(self.cells)
        demands = len(self.gone_demands) + len(self.new_demands) + len(self.bounds)
        return robots + demands


def difference(old: NamedProblem, new: NamedProblem) -> ProblemChanges | None:
    """None if demands that stay are in another order: then little of the old optimum is of use.

    Cheap where robots, demands or their candidates are the same objects as before.
    """
    changes = ProblemChanges()
    before = {demand.id: (index, demand) for index, demand in enumerate(old.demands)}
    places = []
    changed = []
    for demand in new.demands:
        found = before.pop(demand.id, None)
        if found is None:
            changes.new_demands.append(demand)
            continue
        places.append(found[0])
        if found[1] is not demand:
            changed.append((found[1], demand))
    if not all(map(lt, places, places[1:])):
        return None
    changes.gone_demands = list(before)
    if changes.new_demands:
        changes.order = [demand.id for demand in new.demands]
    team = _compare_robots(changes, old, new)
    for one, other in changed:
        if (one.lower, one.upper) != (other.lower, other.upper):
            changes.bounds[one.id] = (other.lower, other.upper)
        if one.candidates is not other.candidates and one.candidates != other.candidates:
            _compare_candidates(changes, one, other, team if team is not None else set(old.robots))
    return changes


def _compare_robots(
    changes: ProblemChanges, old: NamedProblem, new: NamedProblem
) -> set[str] | None:
    """The robots that stay; None: all of them."""
    if old.robots == new.robots:
        return None
    before, after = set(old.robots), set(new.robots)
    changes.gone_robots = [robot for robot in old.robots if robot not in after]
    for robot in new.robots:
        if robot not in before:
            changes.new_robots[robot] = {
                demand.id: demand.candidates[robot]
                for demand in new.demands
                if robot in demand.candidates
            }
    return before & after


def _compare_candidates(
    changes: ProblemChanges, one: NamedDemand, other: NamedDemand, team: set[str]
) -> None:
    for robot, performance in other.candidates.items():
        if one.candidates.get(robot) != performance and robot in team:
            changes.cells.setdefault(robot, {})[one.id] = performance
    for robot in one.candidates:
        if robot not in other.candidates and robot in team:
            changes.cells.setdefault(robot, {})[one.id] = None
