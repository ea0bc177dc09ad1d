"""X.509 certificates for encrypted links: one of the team, which signs those of its members.

All of them follow from the secrets in a folder of keys. A member's common name is its name, so that
Zenoh's access control knows the member at the other end of a link.
"""

from __future__ import annotations

from datetime import UTC, datetime

from cryptography import x509
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey
from cryptography.hazmat.primitives.serialization import Encoding
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from mrbt_mesh.runtime.member_keys import certifying_key, link_key

TEAM = "mrbt team"
# A robot without a real-time clock starts in 1970; the end is RFC 5280's "no expiry".
VALID_FROM = datetime(1970, 1, 1, tzinfo=UTC)
VALID_UNTIL = datetime(9999, 12, 31, 23, 59, 59, tzinfo=UTC)


def team_certificate(team_secret: bytes) -> str:
    """Return the team's own certificate in PEM; it is the same for the same secret."""
    key = certifying_key(team_secret)
    builder = _builder(key.public_key(), _team_name(key), _team_name(key), 1)
    usage = x509.BasicConstraints(ca=True, path_length=0)
    return _signed(builder.add_extension(usage, critical=True), key)


def member_certificate(team_secret: bytes, name: str, member_secret: bytes) -> str:
    """Return a member's certificate in PEM, signed by the team."""
    team, key = certifying_key(team_secret), link_key(member_secret)
    subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])
    builder = _builder(key.public_key(), subject, _team_name(team), x509.random_serial_number())
    uses = [ExtendedKeyUsageOID.SERVER_AUTH, ExtendedKeyUsageOID.CLIENT_AUTH]
    builder = (
        builder.add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .add_extension(x509.ExtendedKeyUsage(uses), critical=False)
        # TLS requires one; it is not compared with anything.
        .add_extension(x509.SubjectAlternativeName([x509.DNSName("mrbt-member")]), critical=False)
    )
    return _signed(builder, team)


def _team_name(key: Ed25519PrivateKey) -> x509.Name:
    """Return a name that differs for each team, so that certificates of teams are not confused."""
    text = f"{TEAM} {key.public_key().public_bytes_raw().hex()[:16]}"
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, text)])


def _builder(
    key: Ed25519PublicKey, subject: x509.Name, issuer: x509.Name, serial: int
) -> x509.CertificateBuilder:
    return (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(issuer)
        .public_key(key)
        .serial_number(serial)
        .not_valid_before(VALID_FROM)
        .not_valid_after(VALID_UNTIL)
    )


def _signed(builder: x509.CertificateBuilder, key: Ed25519PrivateKey) -> str:
    return builder.sign(key, None).public_bytes(Encoding.PEM).decode()
