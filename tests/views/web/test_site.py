"""What is served beside the API: its description, a page, and behind which names."""

from __future__ import annotations

import pytest
from starlette.testclient import TestClient

from mrbt_mesh.views.web.protection import own_names
from mrbt_mesh.views.web.site import site
from tests.support.one_robot import DeskClient

PUBLIC = "https://robots.example/depot"


def client(host: str = "127.0.0.1:8000", public_url: str = "") -> TestClient:
    own = own_names(["127.0.0.1"], 8000, public_url)
    made = site(DeskClient(), None, own, None, public_url)  # type: ignore[arg-type]
    return TestClient(made, base_url=f"http://{host}", follow_redirects=False)


@pytest.mark.parametrize("path", ["/", "/docs", "/v1"])
def test_a_page_lists_the_operations(path: str) -> None:
    answer = client().get(path)
    assert answer.status_code == 200
    assert answer.headers["content-type"].startswith("text/html")
    assert "<code>POST /v1/jobs/{id}/cancel</code>" in answer.text


@pytest.mark.parametrize("path", ["/nothing", "/v1/", "/v1/jobs/", "/docs/"])
def test_nothing_leads_elsewhere(path: str) -> None:
    """A redirection would have the name of the server, not of the proxy before it."""
    answer = client().get(path)
    assert answer.status_code == 404
    assert f"there is no '{path}'; there are " in answer.json()["detail"]
    assert "/v1/jobs/{id}/cancel" in answer.json()["detail"]


def test_a_server_behind_a_proxy_has_its_name() -> None:
    assert client("robots.example").get("/v1/jobs").status_code == 421
    proxied = client("robots.example", PUBLIC)
    assert proxied.get("/v1/jobs").status_code == 200
    assert proxied.get("/openapi.json").json()["servers"] == [{"url": PUBLIC}]
    job = {"id": "one", "type": "inspect", "arguments": {"where": "shelf_1"}}
    answer = proxied.post("/v1/jobs", json=job, headers={"origin": "https://robots.example"})
    assert (answer.status_code, answer.headers["location"]) == (201, "/depot/v1/jobs/one")
    proxied.post("/v1/jobs", json=job | {"id": "two"})
    link = proxied.get("/v1/jobs?limit=1").headers["link"]
    assert link.startswith("</depot/v1/jobs?limit=1&cursor=")
    foreign = proxied.post("/v1/jobs", json=job, headers={"origin": "http://robots.example"})
    assert foreign.status_code == 403
