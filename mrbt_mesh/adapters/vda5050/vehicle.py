"""One vehicle's order as a state machine: its states and the robot's jobs in, messages out.

Pure: time is an argument, ids count up from the session's name, nothing is sent from here.

An order is of this session, of an earlier life of the same robot (`OURS`), or foreign. One of ours
that is no longer needed is cancelled as soon as it is seen: the order of a robot that died, or that
lost its task while its vehicle was out of reach, never runs beside another robot's order. A foreign
order is left alone, and meanwhile the vehicle takes no work of the team.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, TypeAlias

from pydantic import Field

from mrbt_mesh.adapters.vda5050.dialects import (
    INSTANT_ACTIONS,
    ORDER,
    Action,
    Dialect,
    Message,
    VehicleOrder,
    cancel_order,
    clear_instant_actions,
    instant_message,
    order_message,
    state_request,
)
from mrbt_mesh.adapters.vda5050.layout import Layout, RouteError, StopTemplate
from mrbt_mesh.adapters.vda5050.messages import (
    FAILED,
    FATAL,
    FINISHED,
    FOLLOWING,
    INITIALIZING,
    PAUSED,
    RETRIABLE,
    RUNNING,
    STOPPING,
    Link,
    VehicleError,
    VehicleState,
)
from mrbt_mesh.formats.file_model import FileModel

Percent: TypeAlias = Annotated[float, Field(ge=0, le=100)]

# How ids of the adapter's orders begin.
OURS = "mrbt-"
# Period of sending again: orders and instant actions may be lost (quality of service 0).
AGAIN_S = 2.0
# An order that is neither accepted nor refused within this time has failed.
ACCEPT_S = 10.0
# A vehicle that drives on for this long after a cancellation is a fault.
OBEY_S = 10.0
# A pause of this length is a fault: pressing a button by mistake is none.
PAUSED_S = 5.0
# An order without progress for this long has failed, unless the layout file says otherwise.
NO_PROGRESS_S = 120.0
# The standard has vehicles send a state every 30 s at least.
SILENT_S = 45.0
# An outage of the broker of this length is no fault: orders go on.
BROKER_S = 3.0
NO_BROKER = "no connection to the broker"
# Who has said goodbye has to say that it is back: states may have been on their way before.
GOODBYE = frozenset({Link.OFFLINE, Link.HIBERNATING})
ENDED = FINISHED, FAILED
# Finished instant actions are cleared when there are this many.
MANY_INSTANT_ACTIONS = 20
BEGUN = frozenset({INITIALIZING, RUNNING, PAUSED, FINISHED, RETRIABLE})


@dataclass(frozen=True)
class Send:
    """Publish this body, with a header, under a topic of the vehicle."""

    topic: str
    body: Message


@dataclass(frozen=True)
class Ended:
    """The job is over; `reason`: why it failed."""

    success: bool
    reason: str = ""


@dataclass(frozen=True)
class OrderProgress:
    """How much of the order's nodes and actions is done, 0 to 1."""

    fraction: float


Effect: TypeAlias = Send | Ended | OrderProgress


class Battery(FileModel):
    """Below `low_percent` a vehicle takes no orders, until it has `enough_percent` again."""

    low_percent: Percent = 15.0
    enough_percent: Percent = 30.0


class Vehicle:
    """The order of one vehicle. Every method returns what is to be done; `now_s` never goes back.

    `session` is a name that no other life of this robot has.
    """

    def __init__(
        self,
        session: str,
        layout: Layout,
        dialect: Dialect,
        battery: Battery,
        now_s: float,
        no_progress_s: float = NO_PROGRESS_S,
    ) -> None:
        self._session = f"{OURS}{session}"
        self._layout = layout
        self._dialect = dialect
        self._battery = battery
        self._no_progress_s = no_progress_s
        self._count = 0
        self.state: VehicleState | None = None
        self._link = Link.UNKNOWN
        self._job: tuple[StopTemplate, ...] | None = None
        self._order: VehicleOrder | None = None
        # An order that was sent, and whose job is over.
        self._stale: VehicleOrder | None = None
        self._sent_s = self._first_sent_s = now_s
        # The state before the order was sent; what the vehicle has said of the order since.
        self._before: VehicleState | None = None
        self._seen: dict[str, str] = {}
        self._is_taken = False
        # How far the order is, and since when.
        self._progress: tuple[object, ...] = ()
        self._progress_s = now_s
        self._paused_s: float | None = None
        self._cleared_s = now_s - AGAIN_S
        # The cancellation that is under way: its newest id, when it began, when it was sent last.
        self._cancel: tuple[str, float, float] | None = None
        self._unlinked_s: float | None = now_s - BROKER_S
        self._heard_s = now_s
        self._is_low: bool | None = None
        self._was_cut_off = False

    # -- what happens --------------------------------------------------------------------------

    def linked(self, now_s: float) -> list[Effect]:
        """The adapter has its connection to the broker: nothing that was heard before counts."""
        self._unlinked_s = None
        self._link = Link.UNKNOWN
        self.state = None
        self._heard_s = now_s
        return [self._request_state()]

    def unlinked(self, now_s: float) -> list[Effect]:
        """The adapter has lost its connection to the broker."""
        if self._unlinked_s is None:
            self._unlinked_s = now_s
        self._was_cut_off = True
        return []

    def connection(self, link: Link, now_s: float) -> list[Effect]:
        """The vehicle's connection topic, which is retained, or its last will."""
        if link is not Link.ONLINE and self._link is Link.UNKNOWN and self._is_news_due(now_s):
            return []  # a restarted broker may have retained the last wills of its end
        was, self._link = self._link, link
        if link is not Link.ONLINE:
            # Its state will be another one when it comes back.
            self.state = None
            return []
        if was is Link.ONLINE:
            return []
        return [self._request_state()]

    def said(self, state: VehicleState, now_s: float) -> list[Effect]:
        """A state message that is not retained.

        Its vehicle is online even if the connection topic has no word of it or a last will: a
        restarted broker has forgotten that, and not every vehicle announces itself again.
        """
        if self._link in GOODBYE:
            return []
        self.state, self._heard_s, self._link = state, now_s, Link.ONLINE
        if state.charge_percent is not None:
            # One that charges when it is first heard may have been low before.
            is_low = state.is_charging if self._is_low is None else self._is_low
            limit = self._battery.enough_percent if is_low else self._battery.low_percent
            self._is_low = state.charge_percent < limit
        if not state.is_paused:
            self._paused_s = None
        elif self._paused_s is None:
            self._paused_s = now_s
        return [*self._advance(now_s), *self._cleared_instant_actions(state, now_s)]

    def _cleared_instant_actions(self, state: VehicleState, now_s: float) -> list[Effect]:
        """A vehicle of 3.0 reports them for ever, and its list may become full."""
        ended = sum(status in ENDED for status in state.instant_actions.values())
        is_due = self._dialect.keeps_instant_actions and ended >= MANY_INSTANT_ACTIONS
        if not is_due or self._cancel is not None or now_s - self._cleared_s < AGAIN_S:
            return []
        self._cleared_s = now_s
        return [self._instant(clear_instant_actions(self._next_id("clear")))]

    def start(self, stops: Sequence[StopTemplate], now_s: float) -> list[Effect]:
        """A new job; the one before has ended or was cancelled."""
        self._job = tuple(stops)
        self._was_cut_off = False
        return self._advance(now_s)

    def cancel(self, now_s: float) -> list[Effect]:
        """The job is no longer needed: its order is cancelled at the vehicle."""
        self._give_up()
        return self._advance(now_s)

    def tick(self, now_s: float) -> list[Effect]:
        """Time has passed."""
        return self._advance(now_s)

    # -- what is known -------------------------------------------------------------------------

    @property
    def is_reachable(self) -> bool:
        """Whether the vehicle is online and has sent its state."""
        return self._unlinked_s is None and self._link is Link.ONLINE and self.state is not None

    @property
    def is_clear(self) -> bool:
        """Whether nothing of ours is left at the vehicle; unknown while it is out of reach."""
        sent = self._order is not None or self._stale is not None
        return self.is_reachable and not sent and not self._ours_runs()

    def fault(self, now_s: float) -> str:
        """Why this vehicle can do nothing for the team now; empty if it can."""
        if self._unlinked_s is not None:
            return "" if now_s - self._unlinked_s < BROKER_S else NO_BROKER
        if self._link is not Link.ONLINE:
            # Just linked again: the retained messages of the broker have not come yet.
            if self._link is Link.UNKNOWN and self._job is not None and self._is_news_due(now_s):
                return ""
            said = "nothing" if self._link is Link.UNKNOWN else str(self._link)
            return f"the vehicle is not online (connection topic: {said})"
        if self.state is None:
            if self._job is not None and self._is_news_due(now_s):
                return ""
            return "the vehicle has not sent its state"
        if now_s - self._heard_s >= SILENT_S:
            return f"no state of the vehicle for {SILENT_S:g} s"
        return self._trouble(self.state, now_s)

    def _is_news_due(self, now_s: float) -> bool:
        return self._was_cut_off and now_s - self._heard_s < BROKER_S

    def _trouble(self, state: VehicleState, now_s: float) -> str:
        """The fault that a reachable vehicle reports; empty for none."""
        fatal = [str(error) for error in self._errors(state) if error.level == FATAL]
        if fatal:
            return f"the vehicle has a fatal error: {fatal[0]}"
        if state.mode not in FOLLOWING:
            return f"the vehicle's operating mode is {state.mode}"
        if state.emergency_stop not in ("", "NONE"):
            return f"the vehicle's emergency stop is active ({state.emergency_stop})"
        if self._paused_s is not None and now_s - self._paused_s >= PAUSED_S:
            return "the vehicle is paused"
        if self._is_low:
            low, enough = self._battery.low_percent, self._battery.enough_percent
            return f"the vehicle's battery is low: below {low:g} %, until it has {enough:g} %"
        place = state.place
        if place is not None and not place.is_localized:
            return "the vehicle does not know where it is"
        if place is not None and place.map_id not in ("", self._layout.map_id):
            return f"the vehicle is on map {place.map_id}, the layout on {self._layout.map_id}"
        if self._has_foreign_order(state):
            return f"the vehicle has a foreign order ({state.order_id or 'no id'})"
        if self._cancel is not None and now_s - self._cancel[1] >= OBEY_S:
            return "the vehicle does not stop its cancelled order"
        return ""

    # -- what follows --------------------------------------------------------------------------

    def _advance(self, now_s: float) -> list[Effect]:
        if not self.is_reachable or self.state is None:
            return []
        state, order = self.state, self._order
        if order is None:
            if not self._is_cleared(state, now_s):
                return self._cancelled(state, now_s)
            self._stale = self._cancel = None
            return self._begin(state, now_s) if self._job is not None else []
        ours = {name: state.actions[name] for name in order.action_ids if name in state.actions}
        self._seen |= ours
        if state.order_id == order.order_id:
            self._is_taken = True
            return self._judged(state, order, now_s)
        if self._is_taken or ours or self._has_come_to_its_end(state, order):
            return self._dropped(state, order)
        return self._unanswered(state, order, now_s)

    def _is_cleared(self, state: VehicleState, now_s: float) -> bool:
        """Whether nothing of ours runs, or can still begin."""
        if self._ours_runs():
            return False
        stale = self._stale
        if self._cancel is not None and state.is_driving and not self._has_foreign_order(state):
            return False
        if stale is None or state.order_id == stale.order_id or self._refusal(state, stale):
            return True
        if self._has_foreign_order(state):
            return True
        if self._cancel is None:
            return False
        # The vehicle had not received it yet: its answer to the cancellation comes later. Without
        # an answer and without a begin the order was lost; if it begins later, it is cancelled.
        answered = state.status_of(self._cancel[0]) in ENDED
        answered = answered or any(e.is_of("actionId", self._cancel[0]) for e in state.errors)
        return answered or now_s - self._cancel[1] >= OBEY_S

    def _ours_runs(self) -> bool:
        state = self.state
        if state is None:
            return False
        if self._is_stopping(state):
            return True
        if not state.order_id.startswith(OURS):
            return False
        # Up to 2.1 instant actions, e.g. to charge, are among those of the order.
        return bool(state.nodes_left or state.edges_left) or any(
            status not in ENDED
            for name, status in state.actions.items()
            if name.startswith(OURS) and "/" in name
        )

    def _is_stopping(self, state: VehicleState) -> bool:
        """Whether it still carries out a cancellation, of whomever."""
        mine = state.status_of(self._cancel[0]) if self._cancel is not None else None
        return bool(state.stops) or mine not in (None, *ENDED)

    def _has_foreign_order(self, state: VehicleState) -> bool:
        return state.has_active_order and not state.order_id.startswith(OURS)

    def _cancelled(self, state: VehicleState, now_s: float) -> list[Effect]:
        began_s = now_s
        if self._cancel is not None:
            newest, began_s, sent_s = self._cancel
            is_coming_to_rest = state.status_of(newest) in ENDED and not self._ours_runs()
            if self._is_stopping(state) or is_coming_to_rest or now_s - sent_s < AGAIN_S:
                return []
        elif self._is_stopping(state):
            self._cancel = "", now_s, now_s  # that of another adapter
            return []
        action = cancel_order(self._next_id("cancel"))
        self._cancel = action.action_id, began_s, now_s
        return [self._instant(action)]

    def _begin(self, state: VehicleState, now_s: float) -> list[Effect]:
        """Send the job's order, from where the vehicle is now."""
        if self._trouble(state, now_s):
            # The capability is lost, so the plan will take the job away, or it passes.
            return []
        assert self._job is not None
        try:
            order = self._layout.order(self._next_id("order"), state, self._job)
        except RouteError as error:
            return self._end(False, str(error))
        self._order, self._sent_s, self._first_sent_s = order, now_s, now_s
        self._before, self._seen, self._is_taken = state, {}, False
        self._progress, self._progress_s = (), now_s
        return [Send(ORDER, order_message(order, self._dialect))]

    def _unanswered(self, state: VehicleState, order: VehicleOrder, now_s: float) -> list[Effect]:
        refusal = self._refusal(state, order)
        if refusal:
            return self._end(False, f"the vehicle refused the order: {refusal}")
        if now_s - self._first_sent_s >= ACCEPT_S:
            # If it is received later, it will be cancelled: no job has that order.
            new = [str(error) for error in self._errors(state) if self._is_new(error)]
            said = f": {'; '.join(new[:3])}" if new else ""
            return self._end(False, f"the vehicle did not take the order in {ACCEPT_S:g} s{said}")
        if now_s - self._sent_s >= AGAIN_S:
            self._sent_s = now_s
            return [Send(ORDER, order_message(order, self._dialect))]
        return []

    def _has_come_to_its_end(self, state: VehicleState, order: VehicleOrder) -> bool:
        """Whether an idle vehicle that names no order has reached the end of this one since."""
        end = order.nodes[-1].name, order.last_sequence_id
        before = self._before
        was = (before.last_node, before.last_sequence_id) if before is not None else None
        is_idle = not state.order_id and not state.has_active_order
        return is_idle and (state.last_node, state.last_sequence_id) == end != was

    def _dropped(self, state: VehicleState, order: VehicleOrder) -> list[Effect]:
        """The end of an order that the vehicle had taken and does not name any more.

        It is never sent again: what it asks for would be done twice.
        """
        broken = [name for name, status in self._seen.items() if status in (FAILED, RETRIABLE)]
        if broken:
            return self._end(False, self._why(state, order, broken[0]))
        at_end = (state.last_node, state.last_sequence_id)
        if at_end == (order.nodes[-1].name, order.last_sequence_id) and not state.has_active_order:
            return self._end(True, "")
        other = f" and names {state.order_id}" if state.order_id else ""
        return self._end(False, f"the vehicle has dropped the order{other}, {self._done(order)}")

    def _done(self, order: VehicleOrder) -> str:
        """What is known to be done of an order that has not come to its end."""
        actions = [action for node in order.nodes for action in node.actions]
        begun = [a.type for a in actions if self._seen.get(a.action_id) in BEGUN]
        return f"after {', '.join(begun)} had begun" if begun else "before any action had begun"

    def _stalled(self, state: VehicleState, order: VehicleOrder, now_s: float) -> str:
        """Why an order has made no progress for too long; empty if it has."""
        place = state.place
        where = (round(place.x, 1), round(place.y, 1), round(place.theta, 1)) if place else ()
        statuses = tuple(state.actions.get(name, "") for name in order.action_ids)
        left = state.last_sequence_id, state.nodes_left, state.edges_left
        progress = (*left, *statuses, *where)
        is_at_work = {INITIALIZING, RUNNING} & {*statuses} or (state.is_driving and place is None)
        if progress != self._progress or is_at_work:
            self._progress, self._progress_s = progress, now_s
        if now_s - self._progress_s < self._no_progress_s:
            return ""
        why = [f"it waits for an answer to {each}, and gets none" for each in state.requests]
        why += ["its protective field is violated"] if state.is_field_violated else []
        why += ["it asks for more of its base"] if state.wants_base else []
        actions = [action for node in order.nodes for action in node.actions]
        why += [f"its action {a.type} is paused" for a in actions if self._is_paused(a.action_id)]
        because = f": {'; '.join(why)}" if why else ""
        return f"the order has made no progress for {self._no_progress_s:g} s{because}"

    def _is_paused(self, action_id: str) -> bool:
        return self._seen.get(action_id) == PAUSED

    def _judged(self, state: VehicleState, order: VehicleOrder, now_s: float) -> list[Effect]:
        """The progress or the end of the order that the vehicle has accepted."""
        statuses = {name: state.actions.get(name, "") for name in order.action_ids}
        broken = [name for name, status in statuses.items() if status in (FAILED, RETRIABLE)]
        stopping = [error for error in self._errors(state) if error.level in STOPPING]
        if state.nodes_left or state.edges_left or set(statuses.values()) - {FINISHED, FAILED}:
            if stopping and stopping[0].level != FATAL:
                return self._end(False, f"the vehicle cannot go on: {stopping[0]}")
            if broken and not self._was_cut_off:
                return self._end(False, self._why(state, order, broken[0]))
            if stalled := self._stalled(state, order, now_s):
                return self._end(False, stalled)
            done = len(order.nodes) - state.nodes_left
            done += sum(status == FINISHED for status in statuses.values())
            whole = len(order.nodes) + len(order.action_ids)
            return [OrderProgress(max(0, min(done, whole)) / whole)]
        if not broken and state.last_sequence_id == order.last_sequence_id:
            return self._end(True, "")
        if self._was_cut_off and not {*self._seen.values()} & BEGUN:
            # The last will of this adapter has cancelled the order: send it again.
            self._was_cut_off, self._order, self._stale = False, None, None
            return self._begin(state, self._heard_s)
        if broken:
            return self._end(False, self._why(state, order, broken[0]))
        return self._end(False, f"the order ended at {state.last_node}, {self._done(order)}")

    def _why(self, state: VehicleState, order: VehicleOrder, action_id: str) -> str:
        actions = {a.action_id: a for node in order.nodes for a in node.actions}
        result = state.results.get(action_id)
        causes = [result] if result else []
        causes += [str(e) for e in state.errors if e.is_of("actionId", action_id)][:1]
        because = f": {'; '.join(causes)}" if causes else ""
        return f"the vehicle's action {actions[action_id].type} failed{because}"

    def _refusal(self, state: VehicleState, order: VehicleOrder) -> str:
        """Why the vehicle does not take the order: by an error that names it, or none at all."""
        if state.order_id == order.order_id:
            return ""
        errors = [error for error in state.errors if error.is_of("orderId", order.order_id)]
        errors += [
            error
            for error in state.errors
            if error.is_refusal and not error.references and self._is_new(error)
        ]
        return str(errors[0]) if errors else ""

    def _errors(self, state: VehicleState) -> list[VehicleError]:
        """The vehicle's errors, but for those about other orders than the one under way."""
        order = self._order or self._stale
        mine = order.order_id if order is not None else ""
        return [error for error in state.errors if not error.is_of_another("orderId", mine)]

    def _is_new(self, error: VehicleError) -> bool:
        return self._before is None or error not in self._before.errors

    def _end(self, success: bool, reason: str) -> list[Effect]:
        """The job is over; what may be left of its order is cancelled with the next news."""
        self._give_up()
        return [Ended(success, reason)]

    def _give_up(self) -> None:
        self._job = None
        if self._order is not None:
            self._stale, self._order, self._cancel = self._order, None, None

    def _request_state(self) -> Send:
        return self._instant(state_request(self._next_id("state")))

    def _instant(self, action: Action) -> Send:
        return Send(INSTANT_ACTIONS, instant_message([action], self._dialect))

    def _next_id(self, kind: str) -> str:
        self._count += 1
        return f"{self._session}-{kind}-{self._count}"
