"""What both kinds of recorders write of facts and plans."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from pathlib import Path

import pytest

from mrbt_mesh.core.membership.replica import Replica
from mrbt_mesh.recording.channels import REVOKED
from mrbt_mesh.recording.metadata import OBSERVER
from mrbt_mesh.recording.player import Player
from mrbt_mesh.runtime.member_keys import Manifest
from mrbt_mesh.sim import AgentOptions, Leave
from mrbt_mesh.views.replay.verify import verify
from tests.support.keys import keys_of
from tests.support.recorded import read_all, record_example
from tests.support.runs import example

REVOKED_ROBOT, LEFT_US = "B1", 12_000_000


def follow_keys(replica: Replica, alive: Collection[str]) -> None:
    """As if the manifest had revoked this robot's key: it counts as long as it is alive."""
    if REVOKED_ROBOT not in alive and REVOKED_ROBOT in replica.facts.map.authors():
        replica.facts.set_revoked(frozenset({REVOKED_ROBOT}))


@pytest.mark.parametrize("limit", [None, 700_000])
def test_what_a_revocation_takes_away_is_recorded(
    tmp_path: Path, limit: int | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The facts of a robot that has done its work say nothing after it has left; in each part."""
    monkeypatch.setattr(Replica, "follow_keys", follow_keys)
    mission, _ = example("vehicle_repair")
    keys = keys_of(*mission.robots, observer="eye")
    manifest, keys[OBSERVER] = keys["eye"].manifest, keys["eye"]
    options = AgentOptions(keys=keys, record_limit_bytes=limit)
    record_example(tmp_path, "vehicle_repair", 7, ((LEFT_US, Leave(REVOKED_ROBOT)),), options)
    recordings = read_all(tmp_path)
    for each in recordings:
        if each.metadata.robot != REVOKED_ROBOT:
            assert [r.data for r in each.records.of(REVOKED)] == [{"robots": [REVOKED_ROBOT]}]
            player = Player(each)
            player.seek(player.end_us)
            assert player.observer.facts.revoked == {REVOKED_ROBOT}
    texts = {str(each).partition(": ")[2] for each in verify(recordings, manifest).findings}
    assert {text.partition(": ")[2] for text in texts} == {"the key of B1 was not revoked"}
    verdict = verify(recordings, _revoked(manifest))
    assert verdict.is_proved, [*map(str, verdict.findings), *map(str, verdict.gaps)]


def _revoked(manifest: Manifest) -> Manifest:
    member = replace(manifest.members[REVOKED_ROBOT], is_revoked=True)
    return replace(manifest, members={**manifest.members, REVOKED_ROBOT: member})
