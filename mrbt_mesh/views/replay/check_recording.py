"""Checks one recording by itself: its facts, its plans, and whether its robot followed them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from mrbt_mesh.core.assignment.solvers import default_solver
from mrbt_mesh.core.facts.store import Entry, Incarnation, Version
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.membership.keys import Authorship
from mrbt_mesh.core.membership.peer import State
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.core.planning.make_plan import make_plan
from mrbt_mesh.core.planning.plan import Plan
from mrbt_mesh.errors import InputError
from mrbt_mesh.recording import channels
from mrbt_mesh.recording.messages import (
    pack_alive,
    pack_plan,
    pack_statuses,
    read_incarnation,
    same,
)
from mrbt_mesh.recording.reader import RecordedMessage, Recording, state_end
from mrbt_mesh.recording.recorded_state import NothingNewError, RecordedState
from mrbt_mesh.views.replay.check_derived import DerivedCheck, due_us
from mrbt_mesh.views.replay.check_steps import StepCheck
from mrbt_mesh.views.replay.check_work import WorkCheck
from mrbt_mesh.views.replay.checked_recording import CheckedRecording, RecordedFact

# How many plans are kept: robots compute the same plan at about the same time.
KEPT_PLANS = 200
_Cause = tuple[str, bytes, frozenset[str], tuple[tuple[str, Incarnation], ...]]


class PlanAgain:
    """Recomputes plans by the plain definitions, mostly once for the same facts and alive set."""

    def __init__(self, mission: Mission) -> None:
        self.mission = mission
        self._made: dict[_Cause, Plan] = {}

    def plan(self, facts: TeamFacts, alive: Mapping[str, Incarnation]) -> Plan:
        """Return the plan for these facts and these living robots."""
        # Launches of a continued run begin without facts, each with the revision in force then.
        mission, known = facts.in_force.digest, facts.map.digest()
        key = (mission, known, facts.revoked, tuple(sorted(alive.items())))
        if key not in self._made:
            self._made[key] = make_plan(facts, alive, default_solver)
            if len(self._made) > KEPT_PLANS:
                del self._made[next(iter(self._made))]
        return self._made[key]

    def obsolete(self, facts: TeamFacts) -> list[tuple[str, str]]:
        """Return (author, name) of the facts that no node can read any more, sorted."""
        return facts.obsolete(facts.activations)


class RecordingCheck(CheckedRecording):
    """Checks a recording. Iterate over `steps` once."""

    def __init__(
        self, recording: Recording, plans: PlanAgain, authorship: Authorship | None
    ) -> None:
        # A robot may have started with a revision of the mission.
        said, mission = recording.metadata, plans.mission
        if said.mission_digest != mission.digest:
            mission = said.read_mission(str(recording.path))
        super().__init__(recording, mission)
        self._plans = plans
        self._authorship = authorship
        self._work = WorkCheck(self) if self.robot else None
        self._steps = StepCheck(self)
        self._derived = DerivedCheck()
        # Author and name of a fact -> its newest record.
        self._latest: dict[tuple[str, str], RecordedFact] = {}
        self._to_drop: list[tuple[str, str]] = []
        self._made = 0
        # The statuses of T_G's nodes by the last plan.
        self._nodes = ""
        self._later_parts = list(recording.parts[1:])
        # The records on actions in the state at the beginning of a recording that begins late.
        self._actions: list[RecordedMessage] = []

    def steps(self) -> Iterator[int]:
        """Check every record in order; yield the Unix time of each, in us."""
        epoch_us = self.recording.metadata.epoch_ns // 1_000
        for damage in self.recording.damage:
            self.add_to(damage.number, damage.text)
        for record in self.recording.records:
            self._join(record.number)
            try:
                self._check(record)
            except LookupError:
                self.add(record, "it names what neither the mission nor its facts have")
            except ValueError as error:
                self.add(record, str(error))
                if isinstance(error, NothingNewError):
                    # An earlier record may have a version that came later.
                    before = self._latest[record.data["author"], record.data["name"]]
                    text = f"it does not fit record {record.number}: one of them is false"
                    self.add(before, text)
            yield epoch_us + record.at_us
        self._join(self.recording.last[0] + 1)
        if self.recording.cut_off_at is None:
            self._end()

    def _end(self) -> None:
        """Check the end of a complete recording, where nothing may be missing."""
        self._steps.end()
        events = [each.data["event"] for each in self.recording.records.of(channels.LIFE)]
        if events[-2:] not in (["joined", "stopped"], ["caught_up", "stopped"]):
            return  # it did not take part at the end, or its plan was still being computed
        plan, state = self.plan, self.state
        if plan is not None and plan.packed != self._plans.plan(state.facts, state.alive).packed:
            number = self.recording.records[-1].number
            self.add_to(number, "its last plan is not that of its last facts")

    # -- parts --------------------------------------------------------------------------------

    def _join(self, number: int) -> None:
        """Check later parts that begin before the record of this number.

        The state at the beginning of each must be the state at the end of the part before it.
        """
        while self._later_parts and self._later_parts[0].metadata.after_number < number:
            part = self._later_parts.pop(0)
            said, begin = part.metadata, part.metadata.after_number + 1
            if not part.records:
                continue  # its writer was killed when it began it
            try:
                mission = said.read_mission(str(part.path))
                state = RecordedState(TeamFacts(mission, said.run), said.part)
                for record in part.records[: state_end(part.records)]:
                    state.apply(record)
            except (ValueError, InputError) as error:
                self.add_to(begin, f"the state at its beginning cannot be read: {error}")
                continue
            before, after = self.state.to_json(), state.to_json()
            differing = ", ".join(name for name in before if before[name] != after[name])
            if differing or state.changes != self.state.changes:
                text = "the state at its beginning is not that at the end of the part before it"
                self.add_to(begin, f"{text}: other {differing or 'changes'}")

    def _take_state(self, record: RecordedMessage) -> None:
        """Apply a record of the state at the beginning of a recording that begins late."""
        entry = self.state.apply(record)
        if entry is not None:
            self._fact(record, entry)
            if self._work is not None:
                self._work.stood(entry)
        elif record.topic == channels.ACTIONS:
            self._actions.append(record)
        elif record.topic == channels.PARTS:
            self.state_until = record.number
            self._begin_late(record.data)

    def _begin_late(self, data: Mapping[str, Any]) -> None:
        """Check the complete state at the beginning: its plan must follow from its facts."""
        state = self.state
        if data["incarnation"]:
            life = read_incarnation(data["incarnation"])
            self.begins_after = Version(life, data["sequence"])
        self._steps.begin(self._actions, data["ticket"], state.robots)
        if self._work is not None:
            self._work.begin(self._actions)
        if state.plan is None:
            return
        self._plan_again()
        assert self.plan is not None
        digest, self._made = state.facts.map.digest(), state.plan["number"]
        wanted = pack_plan(self.plan, self._made, state.changes, digest, state.alive)
        if any(not same(wanted[key], state.plan.get(key)) for key in wanted):
            raise ValueError("the plan at its beginning does not follow from the facts there")
        if state.statuses is not None and state.statuses["nodes"] != self._nodes:
            raise ValueError("the statuses at its beginning do not follow from the facts there")

    # -- records ------------------------------------------------------------------------------

    def _check(self, record: RecordedMessage) -> None:
        if self.state.is_skipping:
            self._take_state(record)
            return
        topic, data = record.topic, record.data
        self._steps.before(record)
        if topic != channels.DROPPED and self._to_drop:
            names = ", ".join(name for _, name in self._to_drop)
            self._to_drop.clear()
            raise ValueError(f"{names}: should have been dropped before, with others")
        if self._work is not None:
            self._work.before(record)
        if topic == channels.DROPPED:
            self._dropped(data)
        if topic == channels.ALIVE and data["robots"] == pack_alive(self.state.alive):
            raise ValueError("the alive set is recorded again, but has not changed")
        if topic == channels.PLANS:
            self._planned(data)
        if topic == channels.STATUSES:
            self._statuses(data)
        entry = self.state.apply(record)
        if entry is not None:
            self._fact(record, entry)
        self._steps.after(record, entry)
        if entry is not None and self._is_own(entry):
            self._derived.own(entry, record.at_us)
        if self._work is not None:
            self._work.after(record, entry)

    def _is_own(self, entry: Entry) -> bool:
        """Whether the robot wrote it in its present life."""
        mine = self.state.alive.get(self.robot)
        return entry.author == self.robot and entry.version.incarnation == mine

    def _fact(self, record: RecordedMessage, entry: Entry) -> None:
        fact = RecordedFact.of(record, entry)
        self.facts.append(fact)
        if (at_us := due_us(self.state.facts, entry)) is not None:
            self.timed.append((fact, at_us))
        self._latest[fact.author, fact.name] = fact
        self.counts["facts"] += 1
        if self._authorship is not None:
            self.counts["signatures"] += 1
            if not self._authorship.is_authentic(entry):
                raise ValueError(f"{entry.name} was not signed by {entry.author}")

    def _dropped(self, data: Mapping[str, Any]) -> None:
        self.counts["dropped"] += 1
        if not self._to_drop:
            self._to_drop = self._plans.obsolete(self.state.facts)
        wanted = self._to_drop.pop(0) if self._to_drop else None
        if wanted != (data["author"], data["name"]):
            self._to_drop.clear()
            raise ValueError(f"{data['author']}'s {data['name']} is dropped, and still needed")

    def _planned(self, data: Mapping[str, Any]) -> None:
        """The plan must follow from the facts before it, and from its alive set."""
        state = self.state
        self.counts["plans"] += 1
        self._made += 1
        if data["alive"] != pack_alive(state.alive):
            raise ValueError("the plan's alive set is not the one recorded before it")
        if not self._is_alone() and self._plans.obsolete(state.facts):
            raise ValueError("the plan was made with facts that should have been dropped")
        self._plan_again()
        assert self.plan is not None
        digest = state.facts.map.digest()
        wanted = pack_plan(self.plan, self._made, state.changes, digest, state.alive)
        self._made = data["number"]
        differing = [key for key in wanted if not same(wanted[key], data.get(key))]
        if differing:
            what = ", ".join(differing)
            raise ValueError(f"the plan does not follow from its facts: other {what}")

    def _is_alone(self) -> bool:
        """Whether the robot heard no other one, which could need what it would have dropped."""
        others = (data for name, data in self.state.robots.items() if name != self.robot)
        is_heard = any(State(data["state"]).is_healthy and data["joined"] for data in others)
        return not is_heard and len(self.state.facts.mission.robots) > 1

    def _plan_again(self) -> None:
        """Make the plan again, of the facts as they are: a revision may follow it."""
        facts = self.state.facts
        self.plan = self._plans.plan(facts, self.state.alive)
        self._derived.planned(facts, self.plan)
        self._nodes = pack_statuses(self.plan.evaluation.declared_statuses(facts.in_force.tree))

    def _statuses(self, data: Mapping[str, Any]) -> None:
        self.counts["statuses"] += 1
        if self.plan is None or data["plan"] != self._made:
            raise ValueError("statuses of a plan that was not made just before")
        if data["nodes"] != self._nodes:
            raise ValueError("the statuses of T_G's nodes do not follow from the facts")
