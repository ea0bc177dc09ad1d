"""The HTTP API behind a real nginx: no event kept back, TLS, a name and a path of its own."""

from __future__ import annotations

import datetime
import json
import shutil
import ssl
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import httpx2 as httpx
import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import NameOID

from tests.support.paths import mission_file
from tests.support.served import free_ports
from tests.support.team import WAIT_S, Team

NGINX = shutil.which("nginx", path="/usr/sbin:/usr/bin:/usr/local/sbin:/usr/local/bin")
NAME = "robots.example"
# There is an event in each second. nginx passes 4 KB on at once, which is what it is in a minute.
READ_S = 20.0
JOB = {"id": "one", "type": "inspect", "arguments": {"where": "shelf_1"}}
CONFIG = """
daemon off; master_process off; pid nginx.pid; error_log stderr;
events {}
http {
  access_log off;
  client_body_temp_path t1; proxy_temp_path t2; fastcgi_temp_path t3; uwsgi_temp_path t4;
  scgi_temp_path t5;
  server {
    listen 127.0.0.1:PLAIN;
    location / { proxy_pass ADDRESS; }
  }
  server {
    listen 127.0.0.1:SECURE ssl;
    ssl_certificate cert.pem; ssl_certificate_key key.pem;
    location /depot/ { proxy_pass ADDRESS; proxy_set_header Host $http_host; }
  }
}
"""


def write_certificate(folder: Path) -> None:
    key, now = ec.generate_private_key(ec.SECP256R1()), datetime.datetime.now(datetime.UTC)
    name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, NAME)])
    builder = x509.CertificateBuilder(name, name, key.public_key(), x509.random_serial_number())
    builder = builder.not_valid_before(now - datetime.timedelta(days=1))
    builder = builder.not_valid_after(now + datetime.timedelta(days=1))
    names = x509.SubjectAlternativeName([x509.DNSName(NAME)])
    made = builder.add_extension(names, critical=False).sign(key, hashes.SHA256())
    (folder / "cert.pem").write_bytes(made.public_bytes(serialization.Encoding.PEM))
    text = key.private_bytes(
        serialization.Encoding.PEM,
        serialization.PrivateFormat.PKCS8,
        serialization.NoEncryption(),
    )
    (folder / "key.pem").write_bytes(text)


@contextmanager
def proxy(folder: Path, address: str, plain: int, secure: int) -> Iterator[None]:
    assert NGINX is not None
    text = CONFIG.replace("ADDRESS", address)
    text = text.replace("PLAIN", str(plain)).replace("SECURE", str(secure))
    (folder / "nginx.conf").write_text(text)
    write_certificate(folder)
    command = [NGINX, "-p", str(folder), "-c", str(folder / "nginx.conf")]
    process = subprocess.Popen(command)
    try:
        yield
    finally:
        process.terminate()
        process.wait(WAIT_S)


@pytest.mark.skipif(NGINX is None, reason="nginx is not installed (Debian: apt-get install nginx)")
def test_clients_of_a_proxy(team: Team, tmp_path: Path) -> None:
    team.up(mission_file("deliveries"), speed=20)
    team.wait_until(lambda: len(team.robots()) == 6, "all are there")
    plain = free_ports(2)
    secure = plain + 1
    address = team.serve("--public-url", f"https://{NAME}:{secure}/depot")[1]
    with proxy(tmp_path, address, plain, secure):
        context = ssl.create_default_context(cafile=str(tmp_path / "cert.pem"))
        timeout = httpx.Timeout(WAIT_S, read=READ_S)
        with (
            httpx.Client(base_url=f"http://127.0.0.1:{plain}", timeout=timeout) as near,
            httpx.Client(
                base_url=f"https://127.0.0.1:{secure}/depot",
                headers={"host": f"{NAME}:{secure}"},
                timeout=timeout,
                verify=context,
            ) as far,
        ):
            team.wait_until(lambda: is_there(near), "nginx serves")
            follow(near)
            submit(far, f"https://{NAME}:{secure}")


def is_there(client: httpx.Client) -> bool:
    try:
        return client.get("/v1/status").status_code == 200
    except httpx.TransportError:
        return False


def follow(client: httpx.Client) -> None:
    """Each event arrives before the next one: nginx keeps none back. A job is seen in the next."""
    with client.stream("GET", "/v1/events") as stream:
        lines = stream.iter_lines()
        seen = 0
        for line in lines:
            if line.startswith("event: "):
                seen += 1
            if seen == 1 and not line:
                assert client.post("/v1/jobs", json=JOB).status_code == 201
            if line.startswith("data: ") and "job/one" in json.loads(line[6:])["items"]:
                break
        assert seen > 1


def submit(client: httpx.Client, origin: str) -> None:
    """By the public name and path; other origins may not."""

    def post(**headers: str) -> httpx.Response:
        sni = {"sni_hostname": NAME}
        return client.post("/v1/jobs", json=JOB | {"id": "two"}, headers=headers, extensions=sni)

    answer = post(origin=origin)
    assert (answer.status_code, answer.headers["location"]) == (201, "/depot/v1/jobs/two")
    assert post(origin="https://other.example").status_code == 403
    assert post(host="other.example").status_code == 421
