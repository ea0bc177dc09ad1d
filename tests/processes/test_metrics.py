"""Metrics of a team of real processes: of each robot, and of the team by one who watches."""

from __future__ import annotations

import json

from tests.support.served import free_ports, page
from tests.support.team import EXPLORE, Team


def test_robots_and_who_watches_serve_metrics(team: Team) -> None:
    port = free_ports(4)
    team.hold("R1", "R2")
    team.up(EXPLORE, "--robots", "R1,R2", "--metrics-port", str(port))
    path = team.run_dir / "metrics-targets.json"
    targets = json.loads(team.wait_until(lambda: path.exists() and path.read_text(), "targets"))
    where = {target["labels"]["robot"]: target["targets"][0] for target in targets}
    assert where == {"R1": f"127.0.0.1:{port}", "R2": f"127.0.0.1:{port + 1}"}

    def agree() -> bool:
        pages = [page(address) for address in where.values()]
        return all(found.get(("mrbt_agreement",)) == 1 for found in pages)

    team.wait_until(agree, "both robots serve metrics, and agree")
    watched = f"127.0.0.1:{port + 3}"
    watch = team.start(
        *("watch", "--run-dir", str(team.run_dir), "--headless", "--metrics-port", str(port + 3))
    )
    team.wait_until(lambda: page(watched).get(("mrbt_team_robots", "alive")) == 2, "both are seen")

    team.mrbt("kill", "R2", "--run-dir", str(team.run_dir))
    team.wait_until(lambda: page(where["R1"]).get(("mrbt_peer_dead", "R2")) == 1, "R1 sees it")
    team.wait_until(
        lambda: page(watched).get(("mrbt_team_faults_total", "major")) == 1, "the fault"
    )
    assert page(where["R2"]) == {}
    team.release()
    team.end()
    _, problems = watch.communicate(timeout=60)
    assert problems == ""
