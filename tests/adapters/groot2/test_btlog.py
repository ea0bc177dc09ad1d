"""Files with every change of a tree's statuses."""

from __future__ import annotations

from xml.etree import ElementTree

from mrbt_mesh.adapters.groot2.btlog import export
from mrbt_mesh.adapters.node_statuses import ObservedTree
from tests.support.groot2 import Desk, read_btlog

WELD, COVER = 4, 5


def test_a_file_tells_what_happened() -> None:
    desk = Desk()
    data, changes = export.start(desk.observer.mission, 0, 1_700_000_000_000_000)
    for command in ("pass 300", "pass 100", "succeed A", "pass 100", "set A done=true", "pass 100"):
        desk.go(command)
        data += changes(desk.observer, desk.script.team.now_us)
    found = read_btlog(data)
    assert found.began_unix_us == 1_700_000_000_000_000
    names = {int(e.get("_uid", 0)): e.get("name") for e in ElementTree.fromstring(found.xml).iter()}
    assert (names[WELD], names[COVER]) == ("weld", "cover")
    assert found.changes == [
        *((300_000, uid, status) for uid, status in ((1, 1), (2, 1), (3, 3), (WELD, 1))),
        *((400_000, uid, status) for uid, status in ((2, 2), (WELD, 2), (COVER, 1))),
        *((500_000, uid, status) for uid, status in ((3, 2), (WELD, 0))),
    ]


def test_what_a_file_tells_ends_as_the_tree_stands() -> None:
    desk = Desk()
    tree = ObservedTree(desk.observer.mission)
    data, changes = export.start(desk.observer.mission, 0, 0)
    for number in range(40):
        if number == 10:
            desk.go("succeed A")
        if number % 7 == 3:
            desk.go(f"set A done={str(number % 2 == 0).lower()}")
        desk.go("pass 50")
        data += changes(desk.observer, desk.script.team.now_us)
    statuses = dict.fromkeys(range(1, 6), 0)
    before_us = 0
    for at_us, uid, status in read_btlog(data).changes:
        assert at_us >= before_us
        assert statuses[uid] != status, "only what changes is told"
        before_us, statuses[uid] = at_us, status
    assert bytes(statuses.values()) == tree.statuses(desk.observer)
