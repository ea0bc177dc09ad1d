"""Checks what one robot did by its recording: claims and actions against its plans and facts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from mrbt_mesh.core.facts.records import CLAIM, Claim, Outcome, Phase
from mrbt_mesh.core.facts.store import Entry, Incarnation
from mrbt_mesh.core.facts.team_facts import capability
from mrbt_mesh.core.planning.plan import RobotAssignment
from mrbt_mesh.recording import channels
from mrbt_mesh.recording.messages import read_incarnation
from mrbt_mesh.recording.reader import RecordedMessage
from mrbt_mesh.views.replay.checked_recording import CheckedRecording
from mrbt_mesh.views.replay.findings import ProvedTakeover

Place = tuple[str, str]
# The records that can change a plan.
_CAUSES = (channels.FACTS, channels.DROPPED, channels.ALIVE, channels.REVOKED)


class WorkCheck:
    """Follows one robot's recording: its claims and actions against its line of each plan.

    `_at_work`: for a local task of an activation, the robots that ran it, with the incarnation.
    `_planned`: the plan for the current facts. `_is_out`: the robot joins again, catches up, leaves
    or has stopped. `_is_stopping`: its action was cancelled and has not ended yet; until then it
    need not claim anything else, even in its next life.
    """

    def __init__(self, check: CheckedRecording) -> None:
        self._check = check
        self._me = check.robot
        self._at_work: dict[Place, dict[str, Incarnation]] = {}
        self._planned: RecordedMessage | None = None
        self._is_out = False
        self._is_stopping = False
        # The current step, and what the robot held before it: a robot that was fenced drops its
        # claim in the step in which its alive set changes.
        self._step_us = -1
        self._held: Place | None = None

    def begin(self, actions: Sequence[RecordedMessage]) -> None:
        """Start from this state of the robot's action: the recording begins late."""
        self._is_stopping = bool(actions) and actions[-1].data["event"] == "cancelled"

    def stood(self, entry: Entry) -> None:
        """Take a fact of the state at the beginning of a recording that begins late."""
        if isinstance(entry.record, Claim) and entry.record.phase is Phase.RUNNING:
            place = (entry.record.activation, entry.record.local_task)
            self._at_work.setdefault(place, {})[entry.author] = entry.version.incarnation

    def before(self, record: RecordedMessage) -> None:
        """Called before a record is applied.

        The newest plan is valid until facts or alive set change. A plan of the same instant as the
        change need not be followed, because the next one was due.
        """
        if record.at_us != self._step_us:
            self._step_us, self._held = record.at_us, self._claimed_place()
        is_own = record.data.get("author") == self._me and record.data.get("name") == CLAIM
        changes = record.topic in _CAUSES
        if self._planned is not None and changes and not is_own:
            planned, self._planned = self._planned, None
            if record.at_us > planned.at_us:
                self._follows(planned)

    def after(self, record: RecordedMessage, entry: Entry | None) -> None:
        """Called after a record is applied. Raises ValueError for work that is not in the plan."""
        if record.topic == channels.PLANS:
            self._planned = record
        elif record.topic == channels.LIFE:
            self._is_out = record.data["event"] not in ("joined", "caught_up")
        elif record.topic == channels.ACTIONS and record.data["event"] != "progress":
            self._is_stopping = record.data["event"] == "cancelled"
            if record.data["event"] == "started":
                self._check.counts["actions"] += 1
                self._started(record, record.data)
        if entry is not None and isinstance(entry.record, Claim):
            self._claimed(entry, entry.record)

    @property
    def _line(self) -> RobotAssignment | None:
        plan = self._check.plan
        return plan.assignments.get(self._me) if plan is not None else None

    def _claimed(self, entry: Entry, claim: Claim) -> None:
        place = (claim.activation, claim.local_task)
        if claim.phase is Phase.RUNNING:
            self._at_work.setdefault(place, {})[entry.author] = entry.version.incarnation
        mine = self._check.state.alive.get(self._me)
        if entry.author != self._me or entry.version.incarnation != mine:
            return
        self._check.counts["claims"] += 1
        line = self._line
        if line is None or (line.activation, line.local_task) != place:
            said = f"{line.local_task} of {line.activation}" if line else "nothing"
            raise ValueError(
                f"{self._me} claims {claim.local_task} of {claim.activation}; "
                f"its plan gives it {said}"
            )
        if line.global_task != claim.global_task:
            raise ValueError(f"{claim.activation} is one of {line.global_task}")

    def _claimed_place(self) -> Place | None:
        """Return what the robot holds in its current life."""
        state = self._check.state
        held = state.facts.claims.get(self._me)
        claim = held.claim if held is not None else None
        is_mine = held is not None and held.incarnation == state.alive.get(self._me)
        return (claim.activation, claim.local_task) if claim is not None and is_mine else None

    def _follows(self, planned: RecordedMessage) -> None:
        """Check that the robot claims the task of its plan, unless it has ended it or is out."""
        check, line = self._check, self._line
        check.counts["lines"] += 1
        wanted = (line.activation, line.local_task) if line is not None else None
        found = self._claimed_place()
        has_ended = wanted is not None and self._outcome(self._me, wanted) is not None
        may_differ = self._is_out or self._is_stopping or has_ended
        if wanted not in (found, self._held) and not may_differ:
            text = f"{self._me} holds {_text(found)}, and its plan has {_text(wanted)}"
            check.add(planned, text)

    def _started(self, record: RecordedMessage, data: Mapping[str, Any]) -> None:
        place, line = (data["activation"], data["local_task"]), self._line
        entry = self._check.state.facts.map.get(self._me, CLAIM)
        claim = entry.record if entry is not None else None
        if line is None or (line.activation, line.local_task) != place:
            raise ValueError(f"{self._me} starts {_text(place)}, which its plan does not give it")
        phase = Phase.TRAVELLING if "travel_to" in data else Phase.RUNNING
        if (
            not isinstance(claim, Claim)
            or claim.phase is not phase
            or (claim.activation, claim.local_task, claim.global_task, claim.party)
            != (*place, data["global_task"], data["coalition"])
        ):
            raise ValueError(f"{self._me} starts {_text(place)}, and claims something else")
        if phase is Phase.TRAVELLING:
            return
        at_us = record.at_us - self._check.recording.begin_us
        for robot, incarnation in sorted(self._at_work.get(place, {}).items()):
            if robot == self._me:
                continue
            cause = self._cause(robot, incarnation, place)
            if cause:
                of = (robot, *place)
                self._check.takeovers.append(ProvedTakeover(at_us, self._me, *of, cause))

    def _cause(self, robot: str, incarnation: Incarnation, place: Place) -> str:
        """Return why a robot has stopped its work there; empty if it still works or has succeeded.

        Raises ValueError if the recording has no cause.
        """
        state = self._check.state
        local_task = place[1]
        outcome = self._outcome(robot, place)
        if outcome is not None:
            return "" if outcome.success else f"{robot} failed"
        if state.alive.get(robot) != incarnation:
            return self._gone(robot, incarnation)
        member = state.facts.members.get(robot)
        if member is not None and capability(member.member, local_task) is None:
            return f"{robot} lost {local_task}"
        claim = state.facts.valid_claim(robot)
        if claim is None or (claim.activation, claim.local_task) != place:
            return f"{robot} had given it up"
        line = self._check.plan.assignments.get(robot) if self._check.plan is not None else None
        if line is None or (line.activation, line.local_task) != place:
            return f"the plan moved {robot}"
        return ""

    def _outcome(self, robot: str, place: Place) -> Outcome | None:
        said = self._check.state.facts.activations.get(place[0])
        start = f"outcome/{place[0]}/{place[1]}"
        found: Outcome | None = None
        for author, name in sorted(said.keys) if said is not None else ():
            entry = self._check.state.facts.map.get(author, name)
            fits = author == robot and (name == start or name.startswith(f"{start}/"))
            if fits and entry is not None and isinstance(entry.record, Outcome):
                found = entry.record if found is None or entry.record.success else found
        return found

    def _gone(self, robot: str, incarnation: Incarnation) -> str:
        state = self._check.state
        known = state.robots.get(robot)
        if known is None:
            return f"{robot} was not heard since {self._me} began"
        newest = read_incarnation(known["incarnation"])
        member = state.facts.members.get(robot)
        if member is not None and member.incarnation == incarnation and member.member.is_leaving:
            return f"{robot} left"
        if newest == incarnation and known["state"] in ("alive", "suspect") and known["joined"]:
            raise ValueError(f"{robot} is not in the alive set, and is {known['state']}")
        if newest != incarnation:
            return f"{robot} began a new life"
        return f"{robot} is {known['state']}"


def _text(place: Place | None) -> str:
    return f"{place[1]} of {place[0]}" if place is not None else "nothing"
