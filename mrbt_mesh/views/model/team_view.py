"""A running team as items that change: the team, its robots, its tasks, the nodes of its tree."""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import Any, Protocol

from mrbt_mesh.core.bt.tree import Status
from mrbt_mesh.core.facts.records import Phase, problem_text
from mrbt_mesh.core.membership.peer import Peer, State
from mrbt_mesh.core.membership.timing import SECOND_US
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.core.mission.names import name_order
from mrbt_mesh.core.planning.plan import Plan
from mrbt_mesh.features.revisions.facts import Revisions
from mrbt_mesh.formats.mission_map import place_states, told_places
from mrbt_mesh.observer.forecast import forecast_of
from mrbt_mesh.observer.headline import headline, robots_that_differ
from mrbt_mesh.observer.job_history import JobHistory
from mrbt_mesh.observer.job_rows import HELD, RUNNING, WAITING, JobRow, JobRows
from mrbt_mesh.observer.observer import Observer
from mrbt_mesh.observer.time_at_work import late_after_s, time_at_work
from mrbt_mesh.views.model.changes import ChangeLog
from mrbt_mesh.views.model.mission_view import in_units
from mrbt_mesh.views.model.next_steps import run_seconds
from mrbt_mesh.views.model.own_trees import running_tree
from mrbt_mesh.views.model.timeline import TimelineView
from mrbt_mesh.views.model.why import fault_sentence, takeover_told, why_takeover

# Robots whose plans differ normally agree within this time.
AGREED_US = 500_000


class AgreementView:
    """Tracks since when each robot's plan has differed from that of most others.

    `differing`: the robots that have differed for longer than it takes to agree.
    """

    def __init__(self) -> None:
        self._since_us: dict[str, int] = {}
        self.differing: list[str] = []

    def look(self, observer: Observer, now_us: int) -> dict[str, float | None]:
        """Return the robots that differ -> since when, in s."""
        differ = robots_that_differ(observer)
        self._since_us = {robot: self._since_us.get(robot, now_us) for robot in differ}
        self.differing = [r for r, at_us in self._since_us.items() if now_us > at_us + AGREED_US]
        return {r: observer.record.seconds(at_us) for r, at_us in self._since_us.items()}


# How often the forecast is updated while something is late.
LATE_US = SECOND_US
# How many activations of a node are remembered, to count each only once.
KNOWN_ACTIVATIONS = 100


def since_us(row: JobRow, history: JobHistory | None, ended_us: int | None) -> int | None:
    """Return since when a job that is seen for the first time has been in its state.

    The time is on the observer's clock; None if it is not known. `ended_us`: when the job ended,
    possibly by the end of the mission.
    """
    if history is None or row.state == HELD:
        return None
    if row.state == RUNNING:
        return history.begun_us
    if row.state == WAITING:
        return None if history.has_begun else history.submitted_us
    return ended_us


class TeamState:
    """The current state of the team, as its observer knows it. Puts these items into `changes`:

    `team`: command, rounds, revision, the pending revision, whether it has started, how it ended.
    `headline`: statements about its state, the worst first, as objects of `level` (bad, warn, info,
    good) and `text`. `robot/ID`: a robot. `task/NAME`: a global task. `job/ID`: a job, as `JobRow`,
    plus in seconds from the start of the run `since_s` (since when it has been in its state, None
    if nobody saw the change) and `deadline_s` (None without a deadline, or without the team's
    clock). `node/N`: `[status, robots, note, activations]` of a node of T_G that was ever ticked.
    `place/NAME`: a place of the map. `position/ID`: the position that a robot reports.
    """

    def __init__(self, observer: Observer, changes: ChangeLog) -> None:
        self.observer = observer
        self.changes = changes
        self._agreement = AgreementView()
        self._rows = JobRows()
        # Each job with the time in s since when it has been in its state; None: not known.
        self._jobs: dict[str, tuple[JobRow, float | None]] = {}
        # The versions that tasks and nodes depend on; a new plan follows a change of the other two.
        self._causes: tuple[int, int, int] = (-1, -1, 0)
        self._begin(observer.mission)

    def _begin(self, mission: Mission) -> None:
        """Reset the items of the tree, tasks and places for a mission."""
        self._mission = mission
        self._statuses = bytes(len(mission.tree.nodes))
        self._marked: set[int] = set()
        # Node -> the number of its activations, and the newest of them.
        self._activations: dict[int, tuple[int, dict[str, None]]] = {}
        self._counted: Plan | None = None
        self._places = told_places(mission)

    def update(self, now_us: int) -> None:
        """Put items from the observer, which must be up to date."""
        observer = self.observer
        if observer.mission is not self._mission:
            self._take_up(observer.mission)
        differ = self._agreement.look(observer, now_us)
        self.changes.put("team", self._team())
        statements = headline(observer, self._agreement.differing, now_us)
        self.changes.put("headline", [statement.to_json() for statement in statements])
        for robot in observer.robots():
            self.changes.put(f"robot/{robot}", self._robot(robot, differ, now_us))
            self.changes.put(f"position/{robot}", self._position(robot))
        causes = (observer.facts.changes, observer.membership.member_changes, id(observer.plan))
        if causes != self._causes:
            self._causes = causes
            self._what_follows_from_facts(now_us)

    def _take_up(self, mission: Mission) -> None:
        """Switch to a revision that is in force: remove items of nodes, tasks and places that it
        lacks.
        """
        for index in range(len(self._mission.tree.nodes)):
            self.changes.put(f"node/{index}", None)
        for name in self._mission.global_tasks.keys() - mission.global_tasks.keys():
            self.changes.put(f"task/{name}", None)
        for name in told_places(self._mission).keys() - told_places(mission).keys():
            self.changes.put(f"place/{name}", None)
        self._begin(mission)

    def count_activations(self) -> None:
        """Count the plan's activations; for callers that skip `update` after some plans."""
        plan = self.observer.plan
        if plan is not None and plan is not self._counted:
            self._counted = plan
            for request in plan.evaluation.requests:
                node = plan.evaluation.origin_of(request)
                count, known = self._activations.get(node, (0, {}))
                if request.activation not in known:
                    known[request.activation] = None
                    self._activations[node] = count + 1, known
                    if len(known) > KNOWN_ACTIVATIONS:
                        del known[next(iter(known))]

    def _what_follows_from_facts(self, now_us: int) -> None:
        """Update tasks, nodes and places, which change only with the facts."""
        observer, working = self.observer, self._working()
        self._tasks(working)
        if observer.facts.jobs is not None:
            self._put_jobs(now_us)
        if observer.plan is not None:
            self._nodes(observer.plan, working)
        has_succeeded = observer.record.task_log.has_succeeded
        states = place_states(self._places, observer.facts, has_succeeded)
        for name, state in states.items():
            self.changes.put(f"place/{name}", state)

    def _put_jobs(self, now_us: int) -> None:
        observer, record, shown = self.observer, self.observer.record, self._jobs
        now_s = None if record.is_catching_up else record.seconds(now_us)
        rows = self._rows.of(observer)
        for row in rows:
            before, since_s = shown.get(row.id, (None, None))
            if before is row:
                continue
            if before is None:
                history = record.job_log.jobs.get(row.id)
                ended_us = record.job_log.ended_us(history) if history is not None else None
                since_s = record.seconds(since_us(row, history, ended_us))
            elif before.state != row.state:
                since_s = now_s
            shown[row.id] = row, since_s
            deadline_s = run_seconds(observer, row.deadline_us)
            times = {"since_s": since_s, "deadline_s": deadline_s}
            self.changes.put(f"job/{row.id}", asdict(row) | times)
        if len(shown) > len(rows):
            for name in shown.keys() - {row.id for row in rows}:
                del shown[name]
                self.changes.put(f"job/{name}", None)

    def _team(self) -> dict[str, Any]:
        record, end = self.observer.record, self.observer.ended
        result = end.result if end is not None else None
        ended_us = end.at_us if end is not None and record.result is None else record.ended_us
        return {
            "ended": record.result.name.lower() if record.result is not None else result,
            "ended_s": record.seconds(ended_us),
            "command": str(self.observer.facts.order()),
            "started": record.started_us is not None,
            "rounds": record.rounds.all.total,
            "revision": self._mission.number,
            "pending": self._pending_revision(),
        }

    def _pending_revision(self) -> dict[str, Any] | None:
        """Return the revision that waits for robots, its proposer, and these robots.

        None if there is none.
        """
        revisions, in_force = self.observer.facts.index(Revisions), self._mission.number
        pending = revisions.pending(in_force) if revisions.is_used else None
        if pending is None or self.observer.is_over:
            return None
        number = pending[1].number
        robots = revisions.awaited(number, in_force, self.observer.membership.members())
        by = revisions.proposer(number)
        return {"number": number, "by": by, "awaited": sorted(robots, key=name_order)}

    def _robot(self, robot: str, differ: dict[str, Any], now_us: int) -> dict[str, Any]:
        observer = self.observer
        peer = observer.membership.peers.get(robot)
        known = observer.facts.members.get(robot)
        claim = observer.claim(robot)
        beat = peer.heartbeat if peer is not None else None
        is_here = peer is not None and peer.state.is_member
        runs = claim is not None and claim.phase is Phase.RUNNING
        at_work = time_at_work(observer, robot, now_us) if runs else None
        return {
            "state": self._state(robot, peer),
            "type": known.member.type if known else None,
            "host": known.member.host if known else None,
            "pid": known.member.pid if known else None,
            "capabilities": in_units(known.member.capabilities) if known else {},
            "lost": dict(known.member.lost) if known else {},
            "pending": dict(known.member.pending) if known else {},
            "problems": [
                problem_text(subject, each.problem)
                for (of, subject), each in observer.record.problems.items()
                if of == robot and each.to_us is None
            ],
            "local_task": claim.local_task if claim else None,
            "global_task": claim.global_task if claim else None,
            "phase": claim.phase.name.lower() if claim else None,
            "place": observer.facts.place_of(robot),
            "under_way": observer.facts.under_way(robot),
            "begun_s": observer.record.seconds(at_work.since_us) if at_work else None,
            "expected_s": at_work.expected_s if at_work else None,
            "late_after_s": late_after_s(at_work.expected_s) if at_work else None,
            "progress": beat.progress if beat is not None and runs else None,
            "tree": list(running_tree(observer, robot).statuses),
            "statuses": [Status(s).name.lower() for s in beat.statuses] if beat and is_here else [],
            "idle": observer.idle.get(robot, "") if is_here else "",
            "differs_since_s": differ.get(robot),
        }

    def _position(self, robot: str) -> dict[str, Any] | None:
        """Return a robot's last reported position."""
        peer = self.observer.membership.peers.get(robot)
        where = peer.position if peer is not None else None
        return where.in_units() if where is not None else None

    def _state(self, robot: str, peer: Peer | None) -> str:
        """Return the `State` of a robot, or `joining`, or `leaving` (announced, but still there).

        A robot that ended with the run has left.
        """
        state, record = self.observer.robot_state(robot), self.observer.record
        if state is State.DEAD and record.result is not None:
            has_died = any(f.robot == robot and f.until_us is None for f in record.major)
            return str(State.DEAD if has_died else State.LEFT)
        if peer is not None and peer.state.is_healthy:
            if state is State.LEFT:
                return "leaving"
            if not peer.report.has_joined:
                return "joining"
        return str(state)

    def _working(self) -> dict[str, list[str]]:
        """Return activation -> the robots that have claimed it."""
        working: dict[str, list[str]] = {}
        for robot in sorted(self.observer.robots(), key=name_order):
            claim = self.observer.claim(robot)
            if claim is not None:
                working.setdefault(claim.activation, []).append(robot)
        return working

    def _tasks(self, working: dict[str, list[str]]) -> None:
        plan = self.observer.plan
        requests = plan.evaluation.requests if plan is not None else ()
        waiting = {w.activation: w for w in plan.waiting} if plan is not None else {}
        robots: dict[str, list[str]] = {}
        reasons: dict[str, str] = {}
        for request in requests:
            robots.setdefault(request.subject, []).extend(working.get(request.activation, ()))
            if request.activation in waiting:
                reasons[request.subject] = waiting[request.activation].reason
        for name, task in self.observer.record.task_log.tasks.items():
            row = {
                "state": str(task.state),
                "robots": robots.get(name, []),
                "took_part": sorted(task.robots, key=name_order),
                "reason": reasons.get(name, ""),
            }
            self.changes.put(f"task/{name}", row)

    def _nodes(self, plan: Plan, working: dict[str, list[str]]) -> None:
        """Put only the nodes that may have changed: a tree may have thousands."""
        self.count_activations()
        statuses = plan.evaluation.declared_statuses(self.observer.mission.tree)
        waiting = {w.activation: w for w in plan.waiting}
        marks: dict[int, tuple[list[str], str]] = {}
        for request in plan.evaluation.requests:
            found = waiting.get(request.activation)
            note = "" if found is None else ("blocked" if found.is_blocked else "waits")
            node = plan.evaluation.origin_of(request)
            others = marks[node][0] if node in marks else []
            marks[node] = [*others, *working.get(request.activation, [])], note
        changed = {*marks, *self._marked}
        if statuses != self._statuses:
            pairs = zip(statuses, self._statuses, strict=True)
            changed.update(index for index, (new, old) in enumerate(pairs) if new != old)
        for index in sorted(changed):
            robots, note = marks.get(index, ([], ""))
            robots = sorted(robots, key=name_order)
            count, _ = self._activations.get(index, (0, {}))
            self.changes.put(f"node/{index}", [statuses[index], robots, note, count])
        self._statuses, self._marked = statuses, set(marks)


class TakeoversView:
    """Puts `why/N` into a log: the explanation of takeover N.

    It is made at once, because the reasons change later; its times are updated as more is known.
    The reasons of takeovers before this object was made are not known.
    """

    def __init__(self, observer: Observer) -> None:
        self._observer = observer
        # Takeover -> its sentence with the times, and the whole answer.
        self._explained: dict[int, tuple[str, dict[str, Any]]] = {}
        major = observer.record.major
        self._past = {i for i, fault in enumerate(major) if fault.reassigned_us is not None}

    def put(self, log: ChangeLog) -> None:
        """Explain takeovers that are new, or whose times have changed."""
        for index, fault in enumerate(self._observer.record.major):
            if fault.reassigned_us is None:
                continue
            times = fault_sentence(self._observer, fault)
            before, answer = self._explained.get(index, ("", {}))
            if times == before:
                continue
            if not answer:
                explain = takeover_told if index in self._past else why_takeover
                answer = explain(self._observer, fault)
            else:
                answer = answer | {"sentence": times + answer["sentence"].removeprefix(before)}
            self._explained[index] = times, answer
            log.put(f"why/{index}", answer)


class Shown(Protocol):
    """What a page or a terminal shows: a running team (`TeamView`), or a recording of a team."""

    changes: ChangeLog

    @property
    def observer(self) -> Observer:
        """The team as currently shown."""

    def update(self, now_us: int) -> bool:
        """Bring `changes` up to date; return whether anything has changed."""

    def seconds(self, at_us: int) -> float | None:
        """Return a time of the clock in seconds from the start of the run.

        None if it has not begun.
        """


class TeamView:
    """Follows the observer of a running team.

    `changes` has the items of `TeamState`, `TimelineView` and `TakeoversView`, and, if the team
    travels, its `forecast`, whose times count from `at_s`.
    """

    def __init__(self, observer: Observer) -> None:
        self.observer = observer
        self.changes = ChangeLog()
        self._state = TeamState(observer, self.changes)
        self._timeline = TimelineView(observer)
        self._takeovers = TakeoversView(observer)
        # The forecast is updated with every plan, and when something expected has not happened.
        self._foretold: Plan | None = None
        self._late_us: float = math.inf

    def update(self, now_us: int) -> bool:
        """Put items from the observer, which must be up to date.

        Return whether anything has changed.
        """
        before = self.changes.version
        self._state.update(now_us)
        self._timeline.put(self.changes)
        self._takeovers.put(self.changes)
        if self.observer.plan is not self._foretold or now_us >= self._late_us:
            self._foretell(now_us)
        return self.changes.version != before

    def _foretell(self, now_us: int) -> None:
        self._foretold, found = self.observer.plan, forecast_of(self.observer, now_us)
        item = None if found is None else found.to_json() | {"at_s": self.seconds(now_us)}
        self.changes.put("forecast", item)
        next_s = found.next_s if found is not None else math.inf
        self._late_us = now_us + max(LATE_US, next_s * SECOND_US)

    def seconds(self, at_us: int) -> float | None:
        """Return a time of the observer's clock in seconds from the start of the run."""
        return self.observer.record.seconds(at_us)
