"""The rules that namespaces are given, as text. Real ones: tests/processes/test_namespaces.py."""

from __future__ import annotations

import pytest

from mrbt_mesh.drills.namespaces import LinkFault, Namespaces, firewall, shaping, shaping_base

FAULTS = {
    "198.18.0.1": LinkFault(blocked=True),
    "198.18.0.2": LinkFault(loss_permille=300),
    "198.18.0.3": LinkFault(delay_ms=200),
    "198.18.0.4": LinkFault(blocked=True, loss_permille=300),
}


def test_without_netem_the_firewall_cuts_and_loses() -> None:
    assert firewall(FAULTS, with_loss=True).splitlines() == [
        "*filter",
        ":INPUT ACCEPT [0:0]",
        "-A INPUT -s 198.18.0.1/32 -j DROP",
        "-A INPUT -s 198.18.0.2/32 -m statistic --mode random --probability 0.300 -j DROP",
        "-A INPUT -s 198.18.0.4/32 -j DROP",
        "COMMIT",
    ]


def test_with_netem_the_firewall_only_cuts() -> None:
    cuts = [line for line in firewall(FAULTS, with_loss=False).splitlines() if "-A" in line]
    assert cuts == ["-A INPUT -s 198.18.0.1/32 -j DROP", "-A INPUT -s 198.18.0.4/32 -j DROP"]


def test_netem_delays_and_loses_by_source() -> None:
    commands = shaping("p3", FAULTS)
    effects = [c.partition("netem limit 10000 ")[2] for c in commands if "netem" in c]
    assert effects == ["delay 0ms loss 30.0%", "delay 200ms loss 0.0%", "delay 0ms loss 30.0%"]
    matches = [c.partition("u32 match ")[2] for c in commands if c.startswith("filter")]
    assert matches == [
        "ip src 198.18.0.2/32 flowid 1:3",
        "ip src 198.18.0.3/32 flowid 1:4",
        "ip src 198.18.0.4/32 flowid 1:5",
    ]
    assert all("dev p3" in command for command in (*commands, *shaping_base("p3")))


@pytest.mark.parametrize("robots", [[], ["A1", "A1"], [f"R{i}" for i in range(251)], ["A 1"]])
def test_robots_that_cannot_have_namespaces_are_refused(robots: list[str]) -> None:
    with pytest.raises(ValueError, match=r"1 to 250 different robots|1 to 32 letters"):
        Namespaces(robots, "test")


def test_faults_are_between_two_robots_of_the_team() -> None:
    space = Namespaces(["A1", "B1"], "test")
    for source, target in (("A1", "A1"), ("A1", "Z9")):
        with pytest.raises(ValueError, match="not two robots of"):
            space.disturb([(source, target)], blocked=True)
    with pytest.raises(ValueError, match="0 to 1000 permille"):
        space.disturb([("A1", "B1")], loss_permille=1001)
