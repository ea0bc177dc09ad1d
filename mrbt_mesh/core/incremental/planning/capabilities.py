"""Who of the team can do what, kept up to date as robots come, change and go."""

from __future__ import annotations

from collections.abc import Mapping

from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.core.facts.team_facts import TeamFacts, capability
from mrbt_mesh.core.mission.names import type_name
from mrbt_mesh.core.planning.capabilities import Capabilities, Worker, workers

# Above this share of changed robots everything is looked up again.
_MANY = 8


class FollowedCapabilities(Capabilities):
    """Those of a team that changes. A mapping that has changed is a new one."""

    def __init__(self) -> None:
        super().__init__({})
        self._of_type: dict[str, list[str]] = {}
        # Who has a capability of this name; None: to be looked up again.
        self._having: dict[str, dict[str, Worker]] | None = None

    def follow(self, facts: TeamFacts, alive: Mapping[str, Incarnation]) -> None:
        """Take in the team as it is now."""
        before = self.team
        team = {r: _same(before.get(r), worker) for r, worker in workers(facts, alive).items()}
        gone = [worker for robot, worker in before.items() if team.get(robot) is not worker]
        come = [worker for robot, worker in team.items() if before.get(robot) is not worker]
        self.team = team
        if gone or come:
            self._having = None
        if _MANY * (len(gone) + len(come)) > len(team):
            self._able.clear()
            self._of_type.clear()
            return
        for worker in gone:
            for local_task in self._known(worker):
                able = self._able[local_task]
                if worker.id in able:
                    self._able[local_task] = {r: p for r, p in able.items() if r != worker.id}
        for worker in come:
            for local_task in self._known(worker):
                value = capability(worker.member, local_task)
                if value is not None:
                    able = {**self._able[local_task], worker.id: value}
                    self._able[local_task] = {robot: able[robot] for robot in sorted(able)}

    def able(self, local_task: str) -> Mapping[str, int]:
        """The robots that can do it, sorted by id, and how well."""
        able = self._able.get(local_task)
        if able is None:
            kind = type_name(local_task)
            having = self._workers_having(local_task)
            if kind != local_task:
                having = {**having, **self._workers_having(kind)}
            found = ((r, capability(having[r].member, local_task)) for r in sorted(having))
            able = self._able[local_task] = {r: value for r, value in found if value is not None}
            self._of_type.setdefault(kind, []).append(local_task)
        return able

    def _workers_having(self, name: str) -> dict[str, Worker]:
        if self._having is None:
            self._having = {}
            for worker in self.team.values():
                for each in worker.member.capabilities:
                    self._having.setdefault(each, {})[worker.id] = worker
        return self._having.get(name, {})

    def _known(self, worker: Worker) -> list[str]:
        """The local tasks that have been asked for and that a robot has a capability for."""
        types = dict.fromkeys(type_name(name) for name in worker.member.capabilities)
        return [local_task for each in types for local_task in self._of_type.get(each, ())]


def _same(before: Worker | None, worker: Worker) -> Worker:
    """The object from before, if nothing of it has changed."""
    if before is None or before.member is not worker.member:
        return worker
    return before if before.incarnation == worker.incarnation else worker
