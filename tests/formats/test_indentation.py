"""Wrong indentation is called that, also where the file is YAML."""

from __future__ import annotations

import pytest

from mrbt_mesh.errors import FileError
from mrbt_mesh.formats.build import mission_from_yaml
from tests.support.paths import ROOT

MISSION = """\
mission: x
local_tasks:
  fetch: {work: 1}
robot_types:
  robot:
    capabilities: {fetch: 1.0}
robots: {A1: robot}
global_tasks:
  get:
    needs:
      fetch: {min: 1}
tree: get
"""


@pytest.mark.parametrize(
    ("right", "wrong", "message"),
    [
        ("tree: get", "  tree: get", "x.yaml:1: the key 'tree' is missing; line 12 has it, indent"),
        ("      fetch:", "    fetch:", "found nothing; if line 11 belongs to it, indent that"),
        ("    needs:", "  needs:", "found nothing; if line 10 belongs to it, indent that further"),
        ("  get:", "get:", "found nothing; if line 9 belongs to it, indent that further"),
        ("    capab", "  capab", "found nothing; if line 6 belongs to it, indent that further"),
        ("  fetch: {work", "fetch: {work", "found nothing; if line 3 belongs to it, indent that"),
        ("mission: x", "  mission: x", "x.yaml:2: not valid YAML: .*indent them alike"),
        ("robots: {", " robots: {", "line begins in column 2.*indent what belongs together alike"),
    ],
)
def test_wrong_indentation(right: str, wrong: str, message: str) -> None:
    mission_from_yaml(MISSION, "x.yaml", ROOT)
    with pytest.raises(FileError, match=message):
        mission_from_yaml(MISSION.replace(right, wrong, 1), "x.yaml", ROOT)


def test_a_key_that_is_missing_or_empty_is_not_called_indented() -> None:
    for right, wrong in (("tree: get\n", ""), ("robots: {A1: robot}", "robots: nothing")):
        with pytest.raises(FileError) as caught:
            mission_from_yaml(MISSION.replace(right, wrong, 1), "x.yaml", ROOT)
        assert "indent" not in str(caught.value)
