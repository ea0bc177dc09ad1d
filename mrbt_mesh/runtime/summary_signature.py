"""The signature of a run's summary.json, by the observer that wrote it."""

from __future__ import annotations

import json

from mrbt_mesh.core.membership.keys import Keys, Role
from mrbt_mesh.runtime.key_folder import KeyFolder
from mrbt_mesh.runtime.member_keys import Manifest, was_signed
from mrbt_mesh.runtime.run_dir import SUMMARY_FILE, RunDir, RunDirError, write_atomically

SIGNATURE_FILE = "summary.signature"


def sign_summary(run_dir: RunDir) -> None:
    """Sign what was written, in a team with keys. Raises KeysError, RunDirError."""
    if not run_dir.keys_path.is_dir():
        return
    folder, path = KeyFolder(run_dir.keys_path), run_dir.path / SIGNATURE_FILE
    keys = folder.keys_of(folder.reader())
    try:
        summary = (run_dir.path / SUMMARY_FILE).read_bytes()
        write_atomically(path, signature_of(keys, run_dir.info().run, summary))
    except OSError as error:
        raise RunDirError(f"{path} cannot be written: {error.strerror or error}") from error


def signature_of(keys: Keys, run: str, summary: bytes) -> str:
    """The content of the signature's file."""
    data = {"by": keys.name, "signature": keys.sign(_content(run, summary)).hex()}
    return json.dumps(data) + "\n"


def is_summary_signed(manifest: Manifest, run: str, summary: bytes, signature: str) -> bool:
    """Whether an operator or observer of the team has signed this summary of this run."""
    try:
        data = json.loads(signature)
        by, signed = str(data["by"]), bytes.fromhex(data["signature"])
    except (ValueError, TypeError, KeyError):
        return False
    content = _content(run, summary)
    roles = (Role.OPERATOR, Role.OBSERVER)
    return any(was_signed(manifest, by, content, signed, role) for role in roles)


def _content(run: str, summary: bytes) -> bytes:
    return b"mrbt summary\0" + run.encode() + b"\0" + summary
