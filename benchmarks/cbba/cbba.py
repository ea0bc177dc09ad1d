"""CBBA, the bundle auction: the paper's algorithm 3, its table I and equation (5).

Where the paper leaves ties open, of two equal bids that of the robot with the lower number is
higher. All receivers of one sender are treated at once; a robot takes in the messages of a round
in the order of their senders.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.cbba.outcome import NotConvergedError, Outcome, message_bytes, pick
from benchmarks.cbba.scoring import Scoring


def cbba(scoring: Scoring, links: NDArray[np.bool_], *, spread: bool = False) -> Outcome:
    """Auction until all robots agree.

    Raises NotConvergedError after more rounds than gains that diminish can need.
    """
    auction = _Auction(scoring, spread)
    degree = links.sum(axis=1)
    neighbours = [np.flatnonzero(row) for row in links]
    messages = payload = 0
    for rounds in range(scoring.robots * max(scoring.robots, scoring.tasks) + 1):
        if auction.agreed():
            return auction.outcome(rounds, messages, payload)
        sent = auction.bids.copy(), auction.winner.copy(), auction.heard.copy()
        for sender in range(scoring.robots):
            message = sent[0][sender], sent[1][sender], sent[2][sender]
            payload += int(degree[sender]) * message_bytes(message)
            auction.receive(sender, neighbours[sender], message, rounds + 1)
        messages += int(degree.sum())
        auction.release()
        auction.bid()
    raise NotConvergedError(f"CBBA: {scoring.robots} robots, {scoring.tasks} tasks")


class _Auction:
    """Row i is what robot i holds: y, z and s of the paper.

    `winner` is the number of robots where there is none: so it loses all ties. `heard` has
    a column more for it, always 0.
    """

    def __init__(self, scoring: Scoring, spread: bool) -> None:
        self.scoring = scoring
        self.spread = spread
        self.none = scoring.robots
        shape = (scoring.robots, scoring.tasks)
        self.bids = np.zeros(shape, dtype=np.int64)
        self.winner = np.full(shape, self.none)
        self.heard = np.zeros((scoring.robots, scoring.robots + 1), dtype=np.int64)
        self.bundles: list[list[int]] = [[] for _ in range(scoring.robots)]
        self.paths: list[list[int]] = [[] for _ in range(scoring.robots)]
        self.bid()

    def agreed(self) -> bool:
        """Whether all hold the same lists: after `bid` a fixed point of the whole auction."""
        return bool((self.bids == self.bids[0]).all() and (self.winner == self.winner[0]).all())

    def outcome(self, rounds: int, messages: int, payload: int) -> Outcome:
        winners = tuple(-1 if robot == self.none else int(robot) for robot in self.winner[0])
        return Outcome(tuple(map(tuple, self.paths)), winners, rounds, messages, payload)

    def bid(self) -> None:
        """Phase 1, algorithm 3: each robot fills its bundle, best marginal gain first."""
        for robot, (bundle, path) in enumerate(zip(self.bundles, self.paths, strict=True)):
            bids, winner = self.bids[robot], self.winner[robot]
            while len(bundle) < self.scoring.bundle_size:
                gains, places = self.scoring.gains(robot, path)
                wins = (gains > bids) | ((gains == bids) & (robot < winner))
                open_gains = np.where(wins, gains, 0)
                if not open_gains.any():
                    break
                task = pick(open_gains, robot, self.spread)
                bundle.append(task)
                path.insert(int(places[task]), task)
                bids[task], winner[task] = gains[task], robot

    def receive(
        self,
        sender: int,
        receivers: NDArray[np.int64],
        message: tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]],
        now: int,
    ) -> None:
        """Phase 2, table I, for all receivers of a message; then equation (5)."""
        bids, winner, heard = message
        own_bids, own_winner = self.bids[receivers], self.winner[receivers]
        own_heard = self.heard[receivers]
        # Where all agree already, the table changes nothing.
        open_tasks = np.flatnonzero(((own_bids != bids) | (own_winner != winner)).any(axis=0))
        if len(open_tasks):
            bids, winner = bids[open_tasks], winner[open_tasks]
            own_bids, own_winner = own_bids[:, open_tasks], own_winner[:, open_tasks]
            update, reset = table_1(
                sender, receivers, (bids, winner, heard), own_bids, own_winner, own_heard
            )
            cells = np.ix_(receivers, open_tasks)
            self.bids[cells] = np.where(update, bids, np.where(reset, 0, own_bids))
            self.winner[cells] = np.where(update, winner, np.where(reset, self.none, own_winner))
        own_heard = np.maximum(own_heard, heard)
        own_heard[:, sender] = now
        self.heard[receivers] = own_heard

    def release(self) -> None:
        """From the first task of a bundle that was lost on, all are given up: their gains
        were computed with it in the path."""
        for robot, bundle in enumerate(self.bundles):
            lost = next((n for n, t in enumerate(bundle) if self.winner[robot, t] != robot), None)
            if lost is None:
                continue
            for task in bundle[lost + 1 :]:
                if self.winner[robot, task] == robot:
                    self.bids[robot, task], self.winner[robot, task] = 0, self.none
            del bundle[lost:]
            self.paths[robot] = [task for task in self.paths[robot] if task in bundle]


def table_1(
    sender: int,
    receivers: NDArray[np.int64],
    message: tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]],
    own_bids: NDArray[np.int64],
    own_winner: NDArray[np.int64],
    own_heard: NDArray[np.int64],
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """(where to update, where to reset) as receivers x tasks; elsewhere leave.

    Rows of the own arrays are the receivers'. Names: `they` is whom the sender thinks the
    winner, `we` whom the receiver does.
    """
    bids, they, heard = message
    none = own_heard.shape[1] - 1
    we, me = own_winner, receivers[:, None]
    higher = (bids > own_bids) | ((bids == own_bids) & (they < we))
    # Whether the sender's news of a robot is younger, or older, than the receiver's.
    own_of_they = own_heard[:, they]
    newer_of_they, older_of_they = heard[they] > own_of_they, heard[they] < own_of_they
    newer_of_we = heard[we] > np.take_along_axis(own_heard, we, axis=1)

    we_me, we_sender, we_none = we == me, we == sender, we == none
    we_third = ~(we_me | we_sender | we_none)
    they_sender, they_me, they_none = they == sender, they == me, they == none
    they_third = ~(they_sender | they_me | they_none)
    same, differ = we_third & (we == they), we_third & (we != they)

    update = they_sender & (
        (we_me & higher) | we_sender | we_none | (we_third & (newer_of_we | higher))
    )
    update |= (
        they_third
        & newer_of_they
        & ((we_me & higher) | we_sender | same | we_none | (differ & (newer_of_we | higher)))
    )
    update |= they_none & (we_sender | (we_third & newer_of_we))
    reset = they_me & (we_sender | (we_third & newer_of_we))
    reset |= they_third & ((we_sender & ~newer_of_they) | (differ & newer_of_we & older_of_they))
    return update, reset
