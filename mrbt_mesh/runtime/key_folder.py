"""A folder of keys, made and changed by `mrbt keys` and read by members.

manifest.json   the public keys and roles of all members, signed
team.secret     the team's own key, which signs the manifest; robots do not need it
NAME.key        one member's private key, with the team's public key and both certificates

A robot's machine needs only manifest.json and its own NAME.key. Files with private keys are
readable only by their owner.
"""

from __future__ import annotations

import json
import os
import secrets
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from shlex import quote
from typing import Any

from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat

from mrbt_mesh.core.membership.keys import Role
from mrbt_mesh.core.mission.names import is_robot_id
from mrbt_mesh.errors import InputError
from mrbt_mesh.recording.folder import open_regular
from mrbt_mesh.runtime.member_keys import (
    PUBLIC_BYTES,
    SECRET_BYTES,
    Manifest,
    ManifestError,
    MemberKeys,
    PublicKeys,
    link_key,
    parse_manifest,
    public_member,
    signing_key,
)
from mrbt_mesh.runtime.private_files import check_folder, open_to_others
from mrbt_mesh.runtime.run_dir import write_atomically
from mrbt_mesh.runtime.session_config import Certificates

MANIFEST_FILE, TEAM_FILE, KEY_SUFFIX = "manifest.json", "team.secret", ".key"
OPERATOR = "operator"
# A private key has some thousand bytes.
MOST_BYTES = 1 << 20


class KeysError(InputError):
    """Keys are missing, damaged, or cannot be changed; the message has the remedy."""


class KeyFolder:
    """The keys in one folder. All methods raise KeysError for what cannot be read or written."""

    def __init__(self, path: Path) -> None:
        self.path = path

    @property
    def manifest_path(self) -> Path:
        """The path of the manifest."""
        return self.path / MANIFEST_FILE

    # -- making and changing ------------------------------------------------------------------

    @classmethod
    def create(cls, path: Path, members: Mapping[str, Role]) -> KeyFolder:
        """Create the keys of a new team."""
        found = cls(path)
        _check_names(members)
        check_folder(path, "the folder of keys")
        if found.manifest_path.exists():
            how = f"`mrbt keys show --keys {quote(str(path))}`"
            raise KeysError(f"{path} holds a team's keys already: see {how}")
        try:
            path.mkdir(parents=True, exist_ok=True, mode=0o700)
        except OSError as error:
            raise KeysError(f"{path}: cannot be made: {error.strerror}") from None
        secret = secrets.token_bytes(SECRET_BYTES)
        authority = signing_key(secret).public_key().public_bytes_raw()
        _write_secret(path / TEAM_FILE, {"private": secret.hex()})
        found._save(Manifest(0, authority), found._new_keys(members, authority, secret))
        return found

    def add(self, members: Mapping[str, Role], *, replaces: bool = False) -> Manifest:
        """Give keys to new members; with `replaces`, also to members that have or had one.

        Facts that a member signed with a replaced key remain valid.
        """
        manifest = self.manifest()
        _check_names(members)
        known = [name for name in sorted(members) if name in manifest.members]
        if known and not replaces:
            raise KeysError(f"{known[0]} has a key already: give it another one with --replace")
        for name in known:
            if manifest.members[name].role is not members[name]:
                text = f"the role of {name} is {manifest.members[name].role}, and stays so"
                raise KeysError(f"{text}: choose another name for the {members[name]}")
        secret = _read_secret(self.path / TEAM_FILE, "private")
        made = self._new_keys(members, manifest.authority, secret)
        for name in known:
            old = manifest.members[name]
            made[name] = replace(made[name], former=(old.sign, *old.former))
        return self._save(manifest, made)

    def revoke(self, names: Iterable[str]) -> Manifest:
        """Revoke these members' keys."""
        manifest = self.manifest()
        changed = {}
        for name in names:
            member = manifest.members.get(name)
            if member is None:
                listed = ", ".join(sorted(manifest.members))
                raise KeysError(f"the team has no member {name!r} (it has {listed})")
            changed[name] = replace(member, is_revoked=True)
        return self._save(manifest, changed)

    def _new_keys(
        self, members: Mapping[str, Role], authority: bytes, team_secret: bytes
    ) -> dict[str, PublicKeys]:
        # Imported here, because robots never make certificates and the library is large.
        from mrbt_mesh.runtime.member_certificates import member_certificate, team_certificate

        made, trusted = {}, team_certificate(team_secret)
        for name, role in sorted(members.items()):
            secret = secrets.token_bytes(SECRET_BYTES)
            data = {"name": name, "private": secret.hex(), "authority": authority.hex()}
            data["certificate"] = member_certificate(team_secret, name, secret)
            data["team_certificate"] = trusted
            _write_secret(self.path / f"{name}{KEY_SUFFIX}", data)
            made[name] = public_member(secret, role)
        return made

    def _save(self, manifest: Manifest, changed: Mapping[str, PublicKeys]) -> Manifest:
        check_folder(self.path, "the folder of keys")
        secret = _read_secret(self.path / TEAM_FILE, "private")
        members = {**manifest.members, **changed}
        new = Manifest(manifest.version + 1, manifest.authority, members)
        signed = new.signed(signing_key(secret))
        parse_manifest(signed.to_text())
        try:
            write_atomically(self.manifest_path, signed.to_text())
        except OSError as error:
            raise KeysError(f"{self.manifest_path}: cannot be written: {error.strerror}") from None
        return signed

    # -- reading ------------------------------------------------------------------------------

    def manifest(self, authority: bytes | None = None) -> Manifest:
        """Return the manifest. Raises ManifestError if it is not signed by this authority."""
        try:
            with open_regular(self.manifest_path) as file:
                text = file.read().decode()
        except FileNotFoundError:
            what = f"{self.path} holds no {MANIFEST_FILE}: name a folder that"
            raise KeysError(f"{what} `mrbt keys init` has made") from None
        except (OSError, UnicodeDecodeError) as error:
            how = getattr(error, "strerror", "it is no text: copy it again")
            raise KeysError(f"{self.manifest_path} cannot be read: {how}") from None
        try:
            return parse_manifest(text, authority)
        except ManifestError as error:
            raise ManifestError(f"{self.manifest_path}: {error}") from error

    def keys_of(self, name: str) -> MemberKeys:
        """Return the keys that a member needs to take part."""
        check_folder(self.path, "the folder of keys")
        path = self.path / f"{name}{KEY_SUFFIX}"
        authority = _read_secret(path, "authority", PUBLIC_BYTES)
        secret = _read_secret(path, "private")
        manifest = self.manifest(authority)
        member = manifest.members.get(name)
        if member is None or member.is_revoked:
            raise KeysError(f"{name} is not a member of the team in {self.manifest_path}")
        if member.sign != public_member(secret, member.role).sign:
            raise KeysError(f"{path} is not the key that {self.manifest_path} has of {name}")
        return MemberKeys(name, secret, manifest)

    def certificates_of(self, name: str) -> Certificates:
        """Return the certificates that a member shows on encrypted links."""
        path = self.path / f"{name}{KEY_SUFFIX}"
        private = link_key(_read_secret(path, "private"))
        pem = private.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption()).decode()
        data = _read(path)
        try:
            return Certificates(str(data["team_certificate"]), str(data["certificate"]), pem)
        except KeyError:
            text = f"without certificates: make it anew with `mrbt keys add {name} --replace`"
            raise KeysError(f"{path} is of an older version, {text}") from None

    def reader(self) -> str:
        """Return the name to watch with: an operator whose key is here, else an observer."""
        return self._holder("operator's and no observer's", Role.OPERATOR, Role.OBSERVER)

    def router(self) -> str:
        """Return the name of the router whose key is here."""
        return self._holder("router's", Role.ROUTER)

    def _holder(self, what: str, *roles: Role) -> str:
        manifest = self.manifest()
        for role in roles:
            for name, member in sorted(manifest.members.items()):
                here = (self.path / f"{name}{KEY_SUFFIX}").exists()
                if member.role is role and here and not member.is_revoked:
                    return name
        raise KeysError(f"{self.path} holds no {what} key: make one with `mrbt keys add`")


def _check_names(names: Iterable[str]) -> None:
    for name in names:
        if not is_robot_id(name):
            raise KeysError(f"name {name!r}: 1 to 32 letters, digits, '_' or '-'")


def _write_secret(path: Path, data: Mapping[str, str]) -> None:
    """Write or replace a file that only its owner can read."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        descriptor = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        with open(descriptor, "w", encoding="utf-8") as file:
            file.write(json.dumps(data, indent=1) + "\n")
        temporary.replace(path)
    except OSError as error:
        raise KeysError(f"{path}: cannot be written: {error.strerror}") from None


def _read(path: Path) -> dict[str, Any]:
    try:
        with open_regular(path) as file:
            how, content = open_to_others(file), file.read(MOST_BYTES)
        found = json.loads(content)
    except FileNotFoundError:
        raise KeysError(f"{path} does not exist: {_remedy(path)}") from None
    except OSError as error:
        raise KeysError(f"the key {path} cannot be read: {error.strerror}") from None
    except (ValueError, RecursionError):
        found = None
    if how:
        raise KeysError(f"the private key {path} {how}: `chmod 600 {quote(str(path))}`")
    if not isinstance(found, dict):
        raise KeysError(f"{path} is not a private key of `mrbt keys`")
    return found


def _remedy(path: Path) -> str:
    """Return what to do where a file with a private key is missing."""
    if path.name == TEAM_FILE:
        return "change keys in the folder in which `mrbt keys init` made it, or copy it from there"
    return "copy it from where `mrbt keys` made it, or make one with `mrbt keys add`"


def _read_secret(path: Path, key: str, size: int = SECRET_BYTES) -> bytes:
    try:
        found = bytes.fromhex(_read(path)[key])
    except (ValueError, TypeError, KeyError):
        found = b""
    if len(found) != size:
        raise KeysError(f"{path} is not a private key of `mrbt keys`")
    return found


class ManifestWatch:
    """Checks whether the manifest in a folder has changed. `problem` is why it was not applied."""

    def __init__(self, folder: KeyFolder, keys: MemberKeys) -> None:
        self.problem = ""
        self._folder = folder
        self._keys = keys
        self._seen = self._stamp()

    @property
    def is_revoked(self) -> bool:
        """True if this member's key has been revoked or replaced."""
        return self._keys.is_outdated

    def look(self) -> bool:
        """Apply a changed manifest, or set `problem`. Returns True if it had changed."""
        stamp = self._stamp()
        if stamp is None or stamp == self._seen:
            return False
        self._seen = stamp
        before = self._keys.manifest
        try:
            found = self._folder.manifest(before.authority)
        except InputError as error:
            self.problem = str(error)
            return True
        self.problem = ""
        if found.version <= before.version:
            if found == before:
                return False
            self.problem = f"version {found.version} of the manifest is not newer than ours"
            return True
        self._keys.replace(found)
        return True

    def _stamp(self) -> tuple[int, int] | None:
        try:
            status = self._folder.manifest_path.stat()
        except OSError:
            return None
        return status.st_mtime_ns, status.st_ino
