"""Checks that what a recording says of one moment fits together: actions, facts, other robots.

A robot records each of its steps completely, with one time.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from mrbt_mesh.core.facts.records import Claim, Outcome, Phase
from mrbt_mesh.core.facts.store import Entry
from mrbt_mesh.recording import channels
from mrbt_mesh.recording.reader import RecordedMessage
from mrbt_mesh.views.replay.checked_recording import CheckedRecording

_STATES = ("alive", "suspect", "dead")


class StepCheck:
    """Call `before` and `after` a record is applied, and `end` after the last one.

    `_running`: the start of the current action. `_finished`: the start and end of a finished action
    until its outcome is written; that is later if plans are computed in a thread.
    """

    def __init__(self, checked: CheckedRecording) -> None:
        self._checked = checked
        self._step: list[RecordedMessage] = []
        self._running: RecordedMessage | None = None
        self._finished: tuple[RecordedMessage, RecordedMessage] | None = None
        self._ticket = 0
        # The claims of this step by which the robot runs something.
        self._claims: list[tuple[RecordedMessage, Claim]] = []
        # Own outcomes, by their hashes: one that was dropped may come back from a slower robot.
        self._outcomes: set[int] = set()
        # Robot -> its state, as recorded before this step.
        self._states: dict[str, str] = {}

    def begin(
        self, actions: Iterable[RecordedMessage], ticket: int, robots: Mapping[str, Any]
    ) -> None:
        """Start from this state of the action and the other robots: the recording begins late."""
        self._ticket = ticket
        self._running = next((each for each in actions if each.data["event"] == "started"), None)
        self._states = {robot: said["state"] for robot, said in robots.items()}

    def before(self, record: RecordedMessage) -> None:
        """End the step if this record has a later time."""
        if self._step and record.at_us != (begun_us := self._step[0].at_us):
            if record.at_us < begun_us:
                self._checked.add(record, "its time is before that of the record before it")
            self._end_step()

    def after(self, record: RecordedMessage, entry: Entry | None) -> None:
        """Add a record to the step, with its fact if it is one."""
        self._step.append(record)
        if record.topic == channels.ACTIONS:
            self._action(record)
        elif record.topic == channels.LIFE:
            self._finished = None  # its outcome belongs to no life, or to the next one
        elif entry is not None and self._is_own(entry):
            if isinstance(entry.record, Claim) and entry.record.phase is Phase.RUNNING:
                self._claims.append((record, entry.record))
            elif isinstance(entry.record, Outcome) and self._is_news(entry):
                self._outcomes.add(entry.hash)
                self._outcome(record, entry, entry.record)

    def _is_news(self, entry: Entry) -> bool:
        """Return whether an own outcome comes for the first time."""
        begun = self._checked.begins_after
        return entry.hash not in self._outcomes and (begun is None or entry.version > begun)

    def end(self) -> None:
        """Finish: nothing follows."""
        self._end_step()
        self._expect_no_outcome()

    def _is_own(self, entry: Entry) -> bool:
        me = self._checked.robot
        return entry.author == me and entry.version.incarnation == self._checked.state.alive.get(me)

    def _end_step(self) -> None:
        starts = [each for each in self._step if _is_start(each)]
        begun = [_place(each) for each in starts]
        for record, claim in self._claims:
            if (claim.activation, claim.local_task, claim.party) not in begun:
                text = f"its robot claims that it runs {claim.local_task}, and has not started it"
                self._checked.add(record, text)
        self._check_states()
        self._step.clear()
        self._claims.clear()

    # -- the robot's own actions ----------------------------------------------------------------

    def _action(self, record: RecordedMessage) -> None:
        """Check that actions follow one another, each with the next number."""
        event, ticket, running = record.data["event"], record.data["ticket"], self._running
        if event == "started":
            self._expect_no_outcome()
            if running is not None:
                what = running.data["local_task"]
                self._checked.add(record, f"an action starts, and the end of {what} is missing")
            if ticket != self._ticket + 1:
                text = f"action {ticket} starts where action {self._ticket + 1} is due"
                self._checked.add(record, text)
            self._running, self._ticket = record, ticket
            return
        if event == "cancelled" and self._finished is not None:
            running = self._finished[0]
        named = ("ticket", "activation", "global_task", "local_task")
        if running is None or any(running.data[name] != record.data[name] for name in named):
            self._checked.add(record, f"it says {event} of an action that was not started")
        elif event == "finished" and not ("travel_to" in running.data and record.data["success"]):
            self._finished = running, record
        if event in ("finished", "stopped"):
            self._running = None

    def _outcome(self, record: RecordedMessage, entry: Entry, outcome: Outcome) -> None:
        """Check that what the team knows of an action is what the robot recorded of it."""
        finished, self._finished = self._finished, None
        _, activation, local_task, *coalition = entry.parts
        place = (activation, local_task, "".join(coalition))
        if finished is None or _place(finished[0]) != place:
            text = f"an outcome of {local_task}, and no end of it"
            self._checked.add(record, text)
        elif finished[1].data["success"] is not outcome.success:
            text = f"the end of {local_task} and its outcome, record {record.number}, differ"
            self._checked.add(finished[1], text)

    def _expect_no_outcome(self) -> None:
        if self._finished is not None and "travel_to" not in self._finished[0].data:
            what = self._finished[0].data["local_task"]
            self._checked.add(self._finished[1], f"{what} has finished, without an outcome")
        self._finished = None

    # -- the others -----------------------------------------------------------------------------

    def _check_states(self) -> None:
        """Check that a robot's fault and its state fit each other, in both directions."""
        faults = {
            record.data["robot"]: record
            for record in self._step
            if record.topic == channels.FAULTS and record.data["event"] in _STATES
        }
        # A robot that was late processes much at the same time, so another may be alive again at
        # its end.
        said = {
            (record.data["robot"], record.data["state"])
            for record in self._step
            if record.topic == channels.ROBOTS
        }
        for robot, record in faults.items():
            known = self._checked.state.robots.get(robot)
            is_known = known is not None and known["state"] == record.data["event"]
            if not is_known and (robot, record.data["event"]) not in said:
                found = known["state"] if known is not None else "unknown"
                self._checked.add(record, f"{robot} is {record.data['event']} here, and {found}")
        for record in self._step:
            if record.topic == channels.ROBOTS:
                robot, state = record.data["robot"], record.data["state"]
                if state == "dead" != self._states.get(robot) and robot not in faults:
                    self._checked.add(record, f"{robot} is dead, and nobody noticed it")
                self._states[robot] = state


def _is_start(record: RecordedMessage) -> bool:
    """Return whether a local task itself starts."""
    is_started = record.topic == channels.ACTIONS and record.data["event"] == "started"
    return is_started and "travel_to" not in record.data


def _place(record: RecordedMessage) -> tuple[str, str, str]:
    """Return the place of an action's start."""
    return record.data["activation"], record.data["local_task"], record.data["coalition"]
