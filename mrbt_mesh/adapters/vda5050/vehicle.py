"""One vehicle's order as a state machine: its states and the robot's jobs in, messages out.

This module is pure: time is an argument, ids count up from the session's name, and it sends
nothing. An order is from this session, from an earlier incarnation of the same robot (`OURS`), or
foreign. An order of the adapter (`OURS`) that is no longer needed is cancelled as soon as it is
seen: so the order of a robot that died, or that lost its task while its vehicle was out of reach,
never runs beside another robot's order. A foreign order is left alone; meanwhile the vehicle takes
no work of the team.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, field
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

# Prefix of the ids of the adapter's orders.
OURS = "mrbt-"
# Period for repeating messages: orders and instant actions may be lost (quality of service 0).
AGAIN_S = 2.0
# An order that is neither accepted nor refused within this time has failed.
ACCEPT_S = 10.0
# A vehicle that keeps driving for this long after a cancellation is faulty.
OBEY_S = 10.0
# How long to wait for a vehicle that may continue an order that was given up.
HOLD_S = 60.0
# A pause of this length is a fault; a shorter one may be a button pressed by mistake.
PAUSED_S = 5.0
# An order without progress for this long has failed, unless the layout file says otherwise.
NO_PROGRESS_S = 120.0
# The standard requires vehicles to send a state at least every 30 s.
SILENT_S = 45.0
# A shorter outage of the broker is not a fault: orders continue.
BROKER_S = 3.0
NO_BROKER = "no connection to the broker"
# A vehicle that signed off must announce its return: its states may have been sent before.
GOODBYE = frozenset({Link.OFFLINE, Link.HIBERNATING})
ENDED = FINISHED, FAILED
# Finished instant actions are cleared when there are this many.
MANY_INSTANT_ACTIONS = 20
BEGUN = frozenset({INITIALIZING, RUNNING, PAUSED, FINISHED, RETRIABLE})
# A state with a smaller number and an earlier time than the one before is late. If only late states
# arrive for this long, the vehicle has restarted its numbers and its clock was set back.
LATE_S = 10.0
# Unreadable states are a fault once no readable state has arrived for this long.
UNREADABLE_S = 5.0
# A silence of this length is mentioned if an order makes no progress.
SAID_NOTHING_S = 15.0
# A vehicle that names its order but lists nothing of it for this long has forgotten the order.
FORGOTTEN_S = 5.0
# Errors with which a vehicle answers a repeated order that it already has.
KNOWN_ALREADY = frozenset({"orderupdateerror", "sameorderupdateid"})


def ours_runs(state: VehicleState) -> bool:
    """Return whether a vehicle still has nodes, edges or actions of an adapter's order left."""
    if not state.order_id.startswith(OURS):
        return False
    # Up to 2.1, instant actions, e.g. to charge, are listed among those of the order.
    return bool(state.nodes_left or state.edges_left) or any(
        status not in ENDED
        for name, status in state.actions.items()
        if name.startswith(OURS) and "/" in name
    )


@dataclass(frozen=True)
class Send:
    """Publish this body, with a header, under a topic of the vehicle."""

    topic: str
    body: Message


@dataclass(frozen=True)
class Ended:
    """The job has ended; `reason`: why it failed."""

    success: bool
    reason: str = ""


@dataclass(frozen=True)
class OrderProgress:
    """The fraction of the order's nodes and actions that is done, from 0 to 1."""

    fraction: float


Effect: TypeAlias = Send | Ended | OrderProgress


class Battery(FileModel):
    """Below `low_percent` a vehicle takes no orders, until it has `enough_percent` again."""

    low_percent: Percent = 15.0
    enough_percent: Percent = 30.0


@dataclass
class _TakenBack:
    """The order of a cancelled job, and the statuses of its actions seen so far."""

    work: Hashable
    order: VehicleOrder
    seen: dict[str, str] = field(default_factory=dict)
    is_done: bool = False


class Vehicle:
    """The order of one vehicle. Event methods return effects to carry out; `now_s` is monotonic.

    `session` is a name unique to this incarnation of the robot.
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
        self._newest: tuple[int, float] | None = None
        self._newest_s = now_s
        self._job: tuple[StopTemplate, ...] | None = None
        self._order: VehicleOrder | None = None
        # An order that was sent and whose job has ended. It is lost from sight if the vehicle had
        # accepted it, was not seen to end it, and does not list it: it may still be running.
        self._stale: VehicleOrder | None = None
        self._is_lost_from_sight = False
        self._sent_s = self._first_sent_s = now_s
        # The state before the order was sent; the statuses of the order's actions seen since.
        self._before: VehicleState | None = None
        self._seen: dict[str, str] = {}
        self._is_taken = False
        # True if the vehicle was at the order's goal while it named the order.
        self._was_at_goal = False
        # The purpose of the job, and the order of a cancelled job: a vehicle that is out of reach,
        # or does not stop, may still complete it.
        self._work: Hashable = None
        self._taken_back: _TakenBack | None = None
        self._unreadable = ""
        self._listed_s = now_s
        # The progress of the order, and since when it has not changed.
        self._progress: tuple[object, ...] = ()
        self._progress_s = now_s
        self._paused_s: float | None = None
        self._cleared_s = now_s - AGAIN_S
        # The current cancellation: its newest id, when it began, when it was last sent.
        self._cancel: tuple[str, float, float] | None = None
        self._unlinked_s: float | None = now_s - BROKER_S
        self._heard_s = now_s
        self._is_low: bool | None = None
        self._was_cut_off = False

    # -- what happens --------------------------------------------------------------------------

    def linked(self, now_s: float) -> list[Effect]:
        """The adapter has connected to the broker: earlier messages no longer count."""
        self._unlinked_s = None
        self._link = Link.UNKNOWN
        self.state = None
        self._heard_s = now_s
        self._newest, self._unreadable = None, ""
        return [self._request_state()]

    def unlinked(self, now_s: float) -> list[Effect]:
        """The adapter has lost its connection to the broker."""
        if self._unlinked_s is None:
            self._unlinked_s = now_s
        self._was_cut_off = True
        return []

    def connection(self, link: Link, now_s: float) -> list[Effect]:
        """Process a message on the connection topic: a retained one, or the last will."""
        if link is not Link.ONLINE and self._link is Link.UNKNOWN and self._is_news_due(now_s):
            return []  # a restarted broker may have retained last wills from its shutdown
        was, self._link = self._link, link
        if link is not Link.ONLINE:
            # The vehicle's state will have changed when it returns.
            self.state = None
            return []
        if was is Link.ONLINE:
            return []
        self._newest = None
        return [self._request_state()]

    def said(self, state: VehicleState, now_s: float) -> list[Effect]:
        """Process a state message that is not retained.

        It shows that the vehicle is online, even if the connection topic is empty or has a last
        will: a restarted broker has forgotten it, and not every vehicle announces itself again.
        """
        if self._link in GOODBYE or self._is_late(state, now_s):
            return []
        self._unreadable = ""
        self.state, self._heard_s, self._link = state, now_s, Link.ONLINE
        if state.charge_percent is not None:
            # A vehicle that is charging when first heard may have been low before.
            is_low = state.is_charging if self._is_low is None else self._is_low
            limit = self._battery.enough_percent if is_low else self._battery.low_percent
            self._is_low = state.charge_percent < limit
        if not state.is_paused:
            self._paused_s = None
        elif self._paused_s is None:
            self._paused_s = now_s
        return [*self._advance(now_s), *self._cleared_instant_actions(state, now_s)]

    def unreadable(self, reason: str, now_s: float) -> list[Effect]:
        """Process an unreadable state: the vehicle is there, but its activity is unknown."""
        self._unreadable = reason
        return self._advance(now_s)

    def _is_late(self, state: VehicleState, now_s: float) -> bool:
        """Return whether a state arrived after a newer one."""
        if state.header is None:
            return False
        newest = self._newest
        if newest is not None and now_s - self._newest_s < LATE_S:
            (number, unix_s), (newest_number, newest_unix_s) = state.header, newest
            if number < newest_number and unix_s < newest_unix_s:
                return True
        self._newest, self._newest_s = state.header, now_s
        return False

    def _cleared_instant_actions(self, state: VehicleState, now_s: float) -> list[Effect]:
        """Clear ended instant actions: a 3.0 vehicle keeps them, and its list may become full."""
        ended = sum(status in ENDED for status in state.instant_actions.values())
        is_due = self._dialect.keeps_instant_actions and ended >= MANY_INSTANT_ACTIONS
        if not is_due or self._cancel is not None or now_s - self._cleared_s < AGAIN_S:
            return []
        self._cleared_s = now_s
        return [self._instant(clear_instant_actions(self._next_id("clear")))]

    def start(
        self, stops: Sequence[StopTemplate], now_s: float, work: Hashable = None
    ) -> list[Effect]:
        """Start a new job; the previous one must have ended or been cancelled.

        `work`: its purpose. If the same work was cancelled before but the vehicle completed it
        nevertheless, the job succeeds at once.
        """
        self._job, self._work = tuple(stops), work
        self._was_cut_off = False
        return self._advance(now_s)

    def cancel(self, now_s: float) -> list[Effect]:
        """Cancel the job, and its order at the vehicle."""
        if self._job is not None and self._order is not None and self._work is not None:
            self._taken_back = _TakenBack(self._work, self._order, dict(self._seen))
        self._give_up()
        return self._advance(now_s)

    def tick(self, now_s: float) -> list[Effect]:
        """Advance the time."""
        return self._advance(now_s)

    # -- what is known -------------------------------------------------------------------------

    @property
    def is_reachable(self) -> bool:
        """True if the vehicle is online and has sent its state."""
        return self._unlinked_s is None and self._link is Link.ONLINE and self.state is not None

    @property
    def is_clear(self) -> bool:
        """True if the vehicle has no order of the adapter; False while it is out of reach."""
        sent = self._order is not None or self._stale is not None
        return self.is_reachable and not sent and not self._ours_runs()

    @property
    def order_id(self) -> str:
        """The id of the current order; empty if there is none."""
        return self._order.order_id if self._order is not None else ""

    def has_done(self, work: Hashable) -> bool:
        """Return whether the vehicle completed this work although it was cancelled."""
        taken_back = self._taken_back
        return taken_back is not None and taken_back.work == work and taken_back.is_done

    def is_out_of_reach(self, now_s: float) -> bool:
        """Return whether the broker is connected but the vehicle is not reachable."""
        if self._unlinked_s is not None or self.is_reachable:
            return False
        return self._link not in (Link.ONLINE, Link.UNKNOWN) or now_s - self._heard_s >= OBEY_S

    def fault(self, now_s: float) -> str:
        """Return why this vehicle cannot work for the team now; empty if it can."""
        if self._unlinked_s is not None:
            return "" if now_s - self._unlinked_s < BROKER_S else NO_BROKER
        if self._link is not Link.ONLINE:
            # Just reconnected: the broker's retained messages have not arrived yet.
            if self._link is Link.UNKNOWN and self._job is not None and self._is_news_due(now_s):
                return ""
            said = "nothing" if self._link is Link.UNKNOWN else str(self._link)
            return f"the vehicle is not online (connection topic: {said})"
        if self.state is None:
            if self._job is not None and self._is_news_due(now_s):
                return ""
            why = f" that can be read: {self._unreadable}" if self._unreadable else ""
            return f"the vehicle has not sent its state{why}"
        if self._unreadable and now_s - self._heard_s >= UNREADABLE_S:
            return f"the vehicle's states cannot be read: {self._unreadable}"
        if now_s - self._heard_s >= SILENT_S:
            return f"no state of the vehicle for {SILENT_S:g} s"
        return self._trouble(self.state, now_s)

    def _is_news_due(self, now_s: float) -> bool:
        return self._was_cut_off and now_s - self._heard_s < BROKER_S

    def _trouble(self, state: VehicleState, now_s: float) -> str:
        """Return the fault of a reachable vehicle; empty if it has none."""
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
            self._look_at_what_was_taken_back(state)
            if not self._is_cleared(state, now_s):
                return self._cancelled(state, now_s)
            self._stale = self._cancel = None
            if self._job is None:
                return []
            if self._work is not None and self.has_done(self._work):
                self._taken_back = None
                return self._end(True, "")
            return self._begin(state, now_s)
        ours = {name: state.actions[name] for name in order.action_ids if name in state.actions}
        self._seen |= ours
        if state.order_id == order.order_id:
            self._is_taken = True
            self._was_at_goal |= self._is_at_goal(state, order)
            return self._judged(state, order, now_s)
        if self._is_taken or ours or self._has_come_to_its_end(state, order):
            return self._dropped(state, order)
        return self._unanswered(state, order, now_s)

    def _look_at_what_was_taken_back(self, state: VehicleState) -> None:
        taken_back = self._taken_back
        if taken_back is None or state.order_id not in ("", taken_back.order.order_id):
            return
        order, is_named = taken_back.order, state.order_id == taken_back.order.order_id
        taken_back.seen |= {n: state.actions[n] for n in order.action_ids if n in state.actions}
        has_more = is_named and bool(state.nodes_left or state.edges_left)
        is_there = is_named and self._is_at_goal(state, order)
        if not has_more and _is_done(order, taken_back.seen, is_there):
            taken_back.is_done = True

    def _is_at_goal(self, state: VehicleState, order: VehicleOrder) -> bool:
        if state.nodes_left or state.edges_left:
            return False
        end = order.nodes[-1].name, order.last_sequence_id
        return (state.last_node, state.last_sequence_id) == end

    def _is_cleared(self, state: VehicleState, now_s: float) -> bool:
        """Return whether no order of the adapter runs or can still start."""
        if self._ours_runs():
            return False
        stale = self._stale
        if self._cancel is not None and state.is_driving and not self._has_foreign_order(state):
            return False
        if stale is None or self._has_foreign_order(state):
            return True
        is_known = state.order_id == stale.order_id or bool(self._refusal(state, stale))
        if is_known and not self._is_lost_from_sight:
            return True
        if self._cancel is None:
            return False
        # The vehicle may not have received the order yet, so it answers the cancellation later. If
        # it neither answers nor starts, the order was lost; if it starts later, it is cancelled.
        answered = state.status_of(self._cancel[0]) in ENDED
        answered = answered or any(e.is_of("actionId", self._cancel[0]) for e in state.errors)
        limit_s = HOLD_S if self._is_lost_from_sight else OBEY_S
        return answered or now_s - self._cancel[1] >= limit_s

    def _ours_runs(self) -> bool:
        state = self.state
        if state is None:
            return False
        if self._is_stopping(state):
            return True
        return ours_runs(state)

    def _is_stopping(self, state: VehicleState) -> bool:
        """Return whether the vehicle is still carrying out a cancellation, sent by any adapter."""
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
        """Send the job's order, starting at the vehicle's present place."""
        if self._trouble(state, now_s):
            # The capability is lost: the plan will take the job away, or the fault passes.
            return []
        assert self._job is not None
        try:
            order = self._layout.order(self._next_id("order"), state, self._job)
        except RouteError as error:
            return self._end(False, str(error))
        self._order, self._sent_s, self._first_sent_s = order, now_s, now_s
        self._before, self._seen, self._is_taken = state, {}, False
        self._was_at_goal, self._taken_back, self._listed_s = False, None, now_s
        self._progress, self._progress_s = (), now_s
        return [Send(ORDER, order_message(order, self._dialect))]

    def _unanswered(self, state: VehicleState, order: VehicleOrder, now_s: float) -> list[Effect]:
        refusal = self._refusal(state, order)
        if refusal:
            return self._end(False, f"the vehicle refused the order: {refusal}")
        if now_s - self._first_sent_s >= ACCEPT_S:
            # If the order arrives later, it will be cancelled, since no job has it any more.
            new = [str(error) for error in self._errors(state) if self._is_new(error)]
            new += [f"its states cannot be read: {self._unreadable}"] if self._unreadable else []
            said = f": {'; '.join(new[:3])}" if new else ""
            return self._end(False, f"the vehicle did not take the order in {ACCEPT_S:g} s{said}")
        if now_s - self._sent_s >= AGAIN_S:
            self._sent_s = now_s
            return [Send(ORDER, order_message(order, self._dialect))]
        return []

    def _has_come_to_its_end(self, state: VehicleState, order: VehicleOrder) -> bool:
        """Return whether an idle vehicle without an order has since reached this order's end."""
        end = order.nodes[-1].name, order.last_sequence_id
        before = self._before
        was = (before.last_node, before.last_sequence_id) if before is not None else None
        is_idle = not state.order_id and not state.has_active_order
        return is_idle and (state.last_node, state.last_sequence_id) == end != was

    def _dropped(self, state: VehicleState, order: VehicleOrder) -> list[Effect]:
        """End an order that the vehicle had accepted but no longer names.

        It is never sent again, because its actions would be done twice.
        """
        is_there = self._was_at_goal or self._has_come_to_its_end(state, order)
        if _is_done(order, self._seen, is_there or self._is_at_goal(state, order)):
            return self._end(True, "")
        if state.mode not in FOLLOWING:
            return []  # the vehicle was taken out of automatic control, which is a fault
        broken = [name for name, status in self._seen.items() if status in (FAILED, RETRIABLE)]
        if broken:
            return self._end(False, self._why(state, order, broken[0]))
        other = f" and names {state.order_id}" if state.order_id else ""
        text = f"the vehicle has dropped the order{other}; {self._done(order)}"
        return self._end(False, text, is_lost_from_sight=not other)

    def _done(self, order: VehicleOrder) -> str:
        """Describe the last seen statuses of an unfinished order's actions."""
        actions = [action for node in order.nodes for action in node.actions]
        seen = [f"{a.type} {self._seen.get(a.action_id, 'never')}" for a in actions]
        return f"last seen: {', '.join(seen)}" if seen else "it has no actions"

    def _stalled(self, state: VehicleState, order: VehicleOrder, now_s: float) -> str:
        """Return why an order has made no progress for too long; empty if it has made some."""
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
        why += [str(error) for error in self._errors(state) if error.level in STOPPING]
        silent_s = now_s - self._heard_s
        why += [f"it has said nothing for {silent_s:.0f} s"] if silent_s >= SAID_NOTHING_S else []
        here = [node.actions for node in order.nodes if node.name == state.last_node]
        begun = [a for a in actions if self._seen.get(a.action_id) in (RUNNING, INITIALIZING)]
        waits = [a for each in here for a in each if self._seen.get(a.action_id) == "WAITING"]
        if not why and waits and not begun:
            why.append(f"its action {waits[0].type} has not begun, at {state.last_node}")
        because = f": {'; '.join(why)}" if why else ""
        return f"the order has made no progress for {self._no_progress_s:g} s{because}"

    def _is_paused(self, action_id: str) -> bool:
        return self._seen.get(action_id) == PAUSED

    def _judged(self, state: VehicleState, order: VehicleOrder, now_s: float) -> list[Effect]:
        """Return the progress or the end of an order that the vehicle has accepted."""
        # FINISHED actions stay finished: some vehicles list only the remaining ones.
        statuses = {name: self._seen.get(name, "") for name in order.action_ids}
        broken = [name for name, status in statuses.items() if status in (FAILED, RETRIABLE)]
        stopping = [error for error in self._errors(state) if error.level in STOPPING]
        is_there = state.last_sequence_id == order.last_sequence_id
        if not (state.nodes_left or state.edges_left) and _is_done(order, self._seen, is_there):
            return self._end(True, "")
        if state.mode not in FOLLOWING:
            return []  # the vehicle was taken out of automatic control, which is a fault
        if state.nodes_left or state.edges_left or set(statuses.values()) - {FINISHED, FAILED}:
            if stopping and stopping[0].level != FATAL:
                return self._end(False, f"the vehicle cannot go on: {stopping[0]}")
            if broken and not self._was_cut_off:
                return self._end(False, self._why(state, order, broken[0]))
            if self._has_forgotten(state, order, now_s):
                text = "the vehicle names the order and has forgotten what it is"
                return self._end(False, f"{text}; {self._done(order)}", is_lost_from_sight=True)
            if stalled := self._stalled(state, order, now_s):
                return self._end(False, stalled)
            done = len(order.nodes) - state.nodes_left
            done += sum(status == FINISHED for status in statuses.values())
            whole = len(order.nodes) + len(order.action_ids)
            return [OrderProgress(max(0, min(done, whole)) / whole)]
        if self._was_cut_off and not {*self._seen.values()} & BEGUN:
            # The last will of this adapter has cancelled the order: send it again.
            self._was_cut_off, self._order, self._stale = False, None, None
            return self._begin(state, self._heard_s)
        if broken:
            return self._end(False, self._why(state, order, broken[0]))
        where = state.last_node or "no node"
        return self._end(False, f"the order ended at {where}; {self._done(order)}")

    def _has_forgotten(self, state: VehicleState, order: VehicleOrder, now_s: float) -> bool:
        """Return whether the vehicle has listed nothing of the order for FORGOTTEN_S."""
        is_listed = state.nodes_left or state.edges_left or {*state.actions} & {*order.action_ids}
        if is_listed:
            self._listed_s = now_s
        return now_s - self._listed_s >= FORGOTTEN_S

    def _why(self, state: VehicleState, order: VehicleOrder, action_id: str) -> str:
        actions = {a.action_id: a for node in order.nodes for a in node.actions}
        result = state.results.get(action_id)
        causes = [result] if result else []
        causes += [str(e) for e in state.errors if e.is_of("actionId", action_id)][:1]
        because = f": {'; '.join(causes)}" if causes else ""
        return f"the vehicle's action {actions[action_id].type} failed{because}"

    def _refusal(self, state: VehicleState, order: VehicleOrder) -> str:
        """Return why the vehicle refuses the order: an error that names it, or names nothing."""
        if state.order_id == order.order_id:
            return ""
        errors = [error for error in state.errors if error.is_of("orderId", order.order_id)]
        if self._sent_s > self._first_sent_s:
            errors = [error for error in errors if error.kind not in KNOWN_ALREADY]
        errors += [
            error
            for error in state.errors
            if error.is_refusal and not error.references and self._is_new(error)
        ]
        return str(errors[0]) if errors else ""

    def _errors(self, state: VehicleState) -> list[VehicleError]:
        """Return the vehicle's errors, except those about other orders than the current one.

        A FATAL error about any order of the adapter counts until the vehicle withdraws it.
        """
        order = self._order or self._stale
        mine = order.order_id if order is not None else ""
        return [
            error
            for error in state.errors
            if not error.is_of_another("orderId", mine)
            or (error.level == FATAL and not error.is_refusal and _is_about_ours(error))
        ]

    def _is_new(self, error: VehicleError) -> bool:
        return self._before is None or error not in self._before.errors

    def _end(self, success: bool, reason: str, is_lost_from_sight: bool = False) -> list[Effect]:
        """End the job; a possible rest of its order is cancelled at the next event."""
        self._give_up()
        self._is_lost_from_sight = is_lost_from_sight
        return [Ended(success, reason)]

    def _give_up(self) -> None:
        self._job = None
        if self._order is not None:
            self._stale, self._order, self._cancel = self._order, None, None
            self._is_lost_from_sight = False

    def _request_state(self) -> Send:
        return self._instant(state_request(self._next_id("state")))

    def _instant(self, action: Action) -> Send:
        return Send(INSTANT_ACTIONS, instant_message([action], self._dialect))

    def _next_id(self, kind: str) -> str:
        self._count += 1
        return f"{self._session}-{kind}-{self._count}"


def _is_about_ours(error: VehicleError) -> bool:
    return any(key == "orderId" and value.startswith(OURS) for key, value in error.references)


def _is_done(order: VehicleOrder, seen: Mapping[str, str], is_at_goal: bool) -> bool:
    """Return whether the order was seen done: all actions FINISHED, and the goal reached.

    A vehicle that has finished the actions at the goal has been there.
    """
    has_all = all(seen.get(name) == FINISHED for name in order.action_ids)
    return has_all and (is_at_goal or bool(order.nodes[-1].actions))
