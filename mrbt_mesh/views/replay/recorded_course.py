"""The course of a recorded run: how each robot's work went, its bids, and the faults.

A simulation that begins in the middle of the run repeats it.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from mrbt_mesh.core.agent.effects import FeatureEffect
from mrbt_mesh.core.agent.inputs import ActionFinished, ConditionSet
from mrbt_mesh.core.facts.records import (
    ABORTED,
    PAUSED,
    Claim,
    ConditionValue,
    Member,
    NoClaim,
    OperatorCommand,
    Outcome,
    Phase,
)
from mrbt_mesh.core.facts.store import Entry, Incarnation, Version
from mrbt_mesh.core.facts.team_facts import changed_performances
from mrbt_mesh.core.membership.timing import NEVER_US
from mrbt_mesh.features.bids.facts import Bid
from mrbt_mesh.features.bids.messages import BidMade, BidsMade, RequestBid
from mrbt_mesh.observer.episodes import MajorFault
from mrbt_mesh.recording import channels
from mrbt_mesh.recording.messages import read_incarnation
from mrbt_mesh.recording.player import Player
from mrbt_mesh.sim.world import faults
from mrbt_mesh.sim.world.faults import Fault
from mrbt_mesh.sim.world.setup import Place, RecordedWork

# A death is noticed about this long after the end of the process.
NOTICE_US = 20_000


@dataclass
class _Work:
    """One run of a local task.

    It has the begin, the conditions that its robot set from then on, and the fact of its outcome;
    without an outcome, until when it ran at least.
    """

    begun_us: int
    said: list[tuple[int, Version, ConditionSet]] = field(default_factory=list)
    end: tuple[int, Version, Outcome] | None = None
    until_us: int = NEVER_US

    def seen_from(self, at_us: int) -> RecordedWork | None:
        """Return the rest of the work from a time on; None if it has ended by then."""
        from_us = max(at_us, self.begun_us)
        times = self.begun_us - at_us, from_us - self.begun_us
        if self.end is None:
            return RecordedWork(*times, ((max(0, self.until_us - from_us), None),))
        ended_us, last, outcome = self.end
        if ended_us <= at_us:
            return None
        with_end = tuple(
            (each.name, each.value) for _, version, each in self.said if version == last
        )
        end = ActionFinished(0, outcome.success, with_end, reason=outcome.reason)
        before = [
            (said_us - from_us, each)
            for said_us, version, each in self.said
            if version < last and said_us > from_us
        ]
        return RecordedWork(*times, (*before, (ended_us - from_us, end)))


@dataclass(frozen=True)
class _Death:
    """A robot died, or was frozen until `thawed_us`, and others noticed."""

    robot: str
    at_us: int
    noticed_us: int
    thawed_us: int | None

    def is_unnoticed(self, at_us: int) -> bool:
        """Return whether it is dead at that time, and still counted on."""
        return self.at_us <= at_us < self.noticed_us

    def faults(self) -> list[tuple[int, Fault]]:
        if self.thawed_us is None:
            return [(self.at_us, faults.Kill(self.robot))]
        return [
            (self.at_us, faults.Freeze(self.robot)),
            (self.thawed_us, faults.Thaw(self.robot)),
        ]


class RecordedCourse:
    """The course of a player's recording; the player is at its end afterwards."""

    def __init__(self, player: Player) -> None:
        # By robot, activation and local task: the first ones count.
        self._bids: dict[Place, int | None] = {}
        self._mission = player.mission
        self._works: dict[Place, list[_Work]] = {}
        self._running: dict[str, _Work] = {}
        self._ways: list[tuple[int, str]] = []
        self._members: dict[str, tuple[str, Member]] = {}
        self._lives: dict[str, list[tuple[int, Incarnation]]] = {}
        self._faults: list[tuple[int, Fault]] = []
        played = player.play_to(player.end_us)
        records = player.recording.records
        for index, _ in enumerate(played):
            if records.topics[index] not in (channels.FACTS, channels.ROBOTS):
                continue
            record = records[index]
            if record.topic == channels.FACTS:
                entry = player.state.facts.map.get(record.data["author"], record.data["name"])
                if entry is not None:
                    self._fact(entry, record.at_us)
            else:
                self._seen(record.data["robot"], record.data["incarnation"], record.at_us)
        self._deaths = [
            self._death(each) for each in player.observer.record.major if not each.is_older
        ]
        for (robot, *_), works in self._works.items():
            for work in works:
                deaths_us = (d.noticed_us for d in self._deaths if d.robot == robot)
                later_us = [at_us for at_us in deaths_us if at_us > work.begun_us]
                work.until_us = min(work.until_us, player.end_us, *later_us)

    def answer(self, robot: str, asked: FeatureEffect) -> BidsMade | None:
        """Return the robot's recorded bid, if it is asked for one that it made."""
        if not isinstance(asked, RequestBid):
            return None
        names = asked.activation, asked.local_task
        if (robot, *names) not in self._bids:
            return None
        return BidsMade((BidMade(*names, self._bids[robot, *names]),))

    def works_from(self, at_us: int) -> dict[Place, list[RecordedWork]]:
        """Return how all work went that had not ended by then."""
        return {
            place: [seen for each in works if (seen := each.seen_from(at_us)) is not None]
            for place, works in self._works.items()
        }

    def ways_at(self, at_us: int) -> dict[str, int]:
        """Return how long before then each robot last set out."""
        return {robot: at_us - since_us for since_us, robot in self._ways if since_us <= at_us}

    def faults_from(self, at_us: int) -> list[tuple[int, Fault]]:
        """Return the faults after a time, and the operators' commands."""
        found = [each for each in self._faults if each[0] > at_us]
        for death in self._deaths:
            if death.at_us > at_us:
                found += death.faults()
            elif death.thawed_us is not None and death.thawed_us > at_us:
                # The frozen process is not part of the simulation.
                found.append((death.thawed_us, faults.Restart(death.robot)))
        return found

    def deaths_to_notice(self, at_us: int) -> list[tuple[int, Fault]]:
        """Return the ends of robots that were dead by then but still counted on, when others
        notice.
        """
        return [
            (max(at_us, each.noticed_us - NOTICE_US), faults.Kill(each.robot))
            for each in self._deaths
            if each.is_unnoticed(at_us)
        ]

    # -- facts --------------------------------------------------------------------------------

    def _fact(self, entry: Entry, at_us: int) -> None:
        robot, running = entry.author, self._running.get(entry.author)
        match entry.record:
            case Claim() | NoClaim() if running is not None and running.until_us == NEVER_US:
                running.until_us = at_us
                if isinstance(entry.record, Claim):
                    self._fact(entry, at_us)
            case Claim(phase=Phase.TRAVELLING):
                self._ways.append((at_us, robot))
            case Claim(phase=Phase.RUNNING) as claim:
                work = self._running[robot] = _Work(at_us)
                place = (robot, claim.activation, claim.local_task)
                self._works.setdefault(place, []).append(work)
            case Outcome() as outcome:
                _, activation, local_task, *_ = entry.parts
                works = self._works.get((robot, activation, local_task))
                if works and works[-1].end is None:
                    works[-1].end = (at_us, entry.version, outcome)
            case ConditionValue() as condition if running is not None:
                said = ConditionSet(entry.parts[1], condition.value)
                running.said.append((at_us, entry.version, said))
            case Bid(performance):
                _, activation, local_task = entry.parts
                self._bids.setdefault((robot, activation, local_task), performance)
            case OperatorCommand(value, operator) if entry.parts[0] in (PAUSED, ABORTED):
                robot, *also = sorted(self._mission.robots)
                given = str(value) if entry.parts[0] == PAUSED else True
                fault = faults.Operate(robot, entry.name, given, operator, tuple(also))
                self._faults.append((at_us, fault))
            case Member() as member:
                self._described(robot, entry.version.incarnation.nonce, member, at_us)

    def _described(self, robot: str, process: str, member: Member, at_us: int) -> None:
        """Process a robot's description: capabilities lost or restored, and whether it leaves."""
        known, before = self._members.get(robot, ("", None))
        self._members[robot] = (process, member)
        lost: dict[str, str] = {}
        performances: dict[str, int] = {}
        if before is not None and known == process:
            lost, performances = (
                dict(before.lost),
                changed_performances(self._mission, robot, before),
            )
        found: list[Fault] = [
            faults.Lose(robot, name, reason)
            for name, reason in member.lost.items()
            if lost.get(name) != reason
        ]
        found += [faults.Restore(robot, name) for name in lost if name not in member.lost]
        after = changed_performances(self._mission, robot, member)
        declared = self._mission.robots[robot].capabilities if robot in self._mission.robots else {}
        for name in sorted({*performances, *after}):
            value = after.get(name, declared.get(name, 0))
            if performances.get(name, declared.get(name)) != value:
                found.append(faults.ChangePerformance(robot, name, value))
        if member.is_leaving:
            found.append(faults.Leave(robot))
        self._faults += [(at_us, fault) for fault in found]

    # -- lives --------------------------------------------------------------------------------

    def _seen(self, robot: str, incarnation: str, at_us: int) -> None:
        life, lives = read_incarnation(incarnation), self._lives.setdefault(robot, [])
        if all(life.nonce != known.nonce for _, known in lives):
            self._faults.append((at_us, faults.Restart(robot)))
        if not lives or life > lives[-1][1]:
            lives.append((at_us, life))

    def _death(self, fault: MajorFault) -> _Death:
        """Return a death; if the process continues afterwards, it was frozen."""
        lives = self._lives.get(fault.robot, ())
        later = [(seen_us, each) for seen_us, each in lives if each > fault.incarnation]
        thawed_us = fault.until_us
        if later:
            seen_us, life = later[0]
            thawed_us = seen_us if life.nonce == fault.incarnation.nonce else None
        noticed_us = fault.at_us if fault.detected_us is None else fault.detected_us
        return _Death(fault.robot, fault.at_us, noticed_us, thawed_us)
