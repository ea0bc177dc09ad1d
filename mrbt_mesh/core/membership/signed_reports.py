"""Signed self-reports of robots, which others can relay but not change.

A heartbeat is authenticated by tags, which only its receivers can check. Others relay the
self-report in it: that a robot is alive, in which incarnation, with which plan. So a self-report
has its own signature. It is checked only when a relay brings something new, which is seldom, as the
heartbeat itself has usually arrived before.
"""

from __future__ import annotations

from dataclasses import replace

import msgpack

from mrbt_mesh.core.bt.tree import Status
from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.core.membership.keys import Keys, Role
from mrbt_mesh.core.membership.wire import DIGEST_BYTES, SelfReport


def joined_report(life: Incarnation) -> SelfReport:
    """The self-report implied by a robot's own facts once it has joined."""
    return SelfReport(life, 0, bytes(DIGEST_BYTES), True, int(Status.RUNNING))


class SignedReports:
    """Signs one robot's self-reports, and checks those that others relay.

    `keys`: None in a team without keys, where every report is believed.
    """

    def __init__(self, keys: Keys | None, run: str) -> None:
        self._keys = keys
        self._run = run

    @property
    def needs_no_signature(self) -> bool:
        """True in a team without keys."""
        return self._keys is None

    def sign(self, robot: str, report: SelfReport) -> SelfReport:
        """Return the robot's own report with its signature, or unchanged in a team without keys."""
        if self._keys is None:
            return report
        return replace(report, signature=self._keys.sign(self._content(robot, report)))

    def may_be_relayed(self, report: SelfReport) -> bool:
        """False for a report that others could not check, because it was derived from facts."""
        return self._keys is None or bool(report.signature)

    def is_authentic(self, robot: str, report: SelfReport) -> bool:
        """True if the report is signed by the robot that it is about, which is a member in good
        standing.

        Always true in a team without keys.
        """
        keys = self._keys
        if keys is None:
            return True
        return keys.role_of(robot) is Role.ROBOT and keys.is_signed(
            robot, self._content(robot, report), report.signature
        )

    def _content(self, robot: str, report: SelfReport) -> bytes:
        head = ["mrbt report", self._run, robot, *report.incarnation, report.number]
        rest = [report.plan_digest, report.has_joined, report.result]
        return bytes(msgpack.packb([*head, *rest]))
