"""Certificates of members: who may link to whom, by TLS itself."""

from __future__ import annotations

import ssl
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.x509.oid import NameOID

from mrbt_mesh.core.membership.keys import Role
from mrbt_mesh.runtime.key_folder import KeyFolder
from mrbt_mesh.runtime.member_certificates import member_certificate, team_certificate
from mrbt_mesh.runtime.session_config import Certificates

MEMBERS = {"A1": Role.ROBOT, "op": Role.OPERATOR, "r1": Role.ROUTER}
TEAM, OTHER = bytes(range(32)), bytes(32)


def name_of(pem: str) -> str:
    certificate = x509.load_pem_x509_certificate(pem.encode())
    (attribute,) = certificate.subject.get_attributes_for_oid(NameOID.COMMON_NAME)
    return str(attribute.value)


def context(purpose: ssl.Purpose, shown: Certificates, folder: Path) -> ssl.SSLContext:
    """One end of a link that shows a certificate and demands one, by OpenSSL."""
    found = ssl.create_default_context(purpose, cadata=shown.authority)
    found.check_hostname = False
    found.verify_mode = ssl.CERT_REQUIRED
    path = folder / f"{name_of(shown.certificate)}.pem"
    path.write_text(shown.private + shown.certificate)
    found.load_cert_chain(path)
    return found


def handshake(one: Certificates, other: Certificates, folder: Path) -> str:
    """The common name that the server sees; raises ssl.SSLError if they do not trust each other."""
    to_server, to_client = ssl.MemoryBIO(), ssl.MemoryBIO()
    server = context(ssl.Purpose.CLIENT_AUTH, one, folder).wrap_bio(
        to_server, to_client, server_side=True
    )
    client = context(ssl.Purpose.SERVER_AUTH, other, folder).wrap_bio(to_client, to_server)
    done = set()
    while len(done) < 2:
        for end in (client, server):
            try:
                end.do_handshake()
                done.add(end)
            except ssl.SSLWantReadError:
                continue
    seen = server.getpeercert()
    assert seen is not None
    (((_, name),),) = seen["subject"]
    return str(name)


@pytest.fixture
def keys(tmp_path: Path) -> KeyFolder:
    return KeyFolder.create(tmp_path / "keys", MEMBERS)


def test_members_of_a_team_trust_each_other_and_show_their_names(
    keys: KeyFolder, tmp_path: Path
) -> None:
    router, robot = keys.certificates_of("r1"), keys.certificates_of("A1")
    assert handshake(router, robot, tmp_path) == "A1"
    assert handshake(robot, router, tmp_path) == "r1"


def test_members_of_another_team_are_not_trusted(keys: KeyFolder, tmp_path: Path) -> None:
    strangers = KeyFolder.create(tmp_path / "strangers", MEMBERS)
    with pytest.raises(ssl.SSLError):
        handshake(keys.certificates_of("r1"), strangers.certificates_of("A1"), tmp_path)
    with pytest.raises(ssl.SSLError):
        handshake(strangers.certificates_of("r1"), keys.certificates_of("A1"), tmp_path)


def test_a_member_cannot_make_members(keys: KeyFolder, tmp_path: Path) -> None:
    """Whoever trusts the team does not trust what a member has signed."""
    robot = keys.certificates_of("A1")
    forged = Certificates(robot.authority, member_certificate(OTHER, "op", TEAM), robot.private)
    with pytest.raises(ssl.SSLError):
        handshake(keys.certificates_of("r1"), forged, tmp_path)


def test_those_who_join_later_are_of_the_same_team(keys: KeyFolder, tmp_path: Path) -> None:
    keys.add({"B1": Role.ROBOT})
    keys.add({"A1": Role.ROBOT}, replaces=True)
    assert keys.certificates_of("B1").authority == keys.certificates_of("r1").authority
    for name in ("A1", "B1"):
        shown = handshake(keys.certificates_of("r1"), keys.certificates_of(name), tmp_path)
        assert shown == name


def test_the_teams_certificate_follows_from_its_secret() -> None:
    assert team_certificate(TEAM) == team_certificate(TEAM)
    assert name_of(team_certificate(TEAM)) != name_of(team_certificate(OTHER))
