"""What a recording says of its team is what its mission says."""

from __future__ import annotations

from mrbt_mesh.core.membership.timing import Timing
from mrbt_mesh.features.revisions.section import Revision, with_revision
from mrbt_mesh.recording.metadata import RunMetadata
from tests.support.build import action, make_mission, task

MISSION = make_mission(action("a1"), {"A": {"t": 1}}, [task("a1", ("t", 1, 1))])


def test_a_revision_names_the_mission_with_which_its_team_was_started() -> None:
    count = len(MISSION.tree.nodes)
    revised = with_revision(MISSION, Revision(1, MISSION.digest, count, tuple(range(count))))
    assert revised.digest != MISSION.digest
    for mission in (MISSION, revised):
        said = RunMetadata.of(mission, "A", "r1", Timing(), 0, "1")
        assert said.team_digest == mission.team_digest == MISSION.digest
