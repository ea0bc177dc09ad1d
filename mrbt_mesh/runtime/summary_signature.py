"""The signature of a run's summary.json, by the observer that wrote it; it also covers how many
commands had been noted then.
"""

from __future__ import annotations

import json
from dataclasses import dataclass

from mrbt_mesh.core.membership.keys import Keys, Role
from mrbt_mesh.runtime.command_log import head_of, read_commands
from mrbt_mesh.runtime.key_folder import KeyFolder
from mrbt_mesh.runtime.member_keys import Manifest, was_signed
from mrbt_mesh.runtime.run_dir import (
    COMMANDS_FILE,
    SUMMARY_FILE,
    RunDir,
    RunDirError,
    write_atomically,
)

SIGNATURE_FILE = "summary.signature"


def sign_summary(run_dir: RunDir) -> None:
    """Sign what was written, in a team with keys. Raises KeysError, RunDirError."""
    if not run_dir.keys_path.is_dir():
        return
    folder, path = KeyFolder(run_dir.keys_path), run_dir.path / SIGNATURE_FILE
    keys = folder.keys_of(folder.reader())
    try:
        summary = (run_dir.path / SUMMARY_FILE).read_bytes()
        commands = head_of(read_commands(run_dir.path / COMMANDS_FILE))
        write_atomically(path, signature_of(keys, run_dir.info().run, summary, commands))
    except OSError as error:
        raise RunDirError(f"{path} cannot be written: {error.strerror or error}") from error


@dataclass(frozen=True)
class SignedSummary:
    """What the signature's file has: `commands` is the hash of the last command noted then."""

    by: str
    commands: str
    signature: bytes

    def is_for(self, manifest: Manifest, run: str, summary: bytes) -> bool:
        """Whether an operator or observer of the team has signed this summary of this run."""
        content = _content(run, summary, self.commands)
        roles = (Role.OPERATOR, Role.OBSERVER)
        return any(was_signed(manifest, self.by, content, self.signature, role) for role in roles)


def signature_of(keys: Keys, run: str, summary: bytes, commands: str = "") -> str:
    """The content of the signature's file."""
    signature = keys.sign(_content(run, summary, commands)).hex()
    return json.dumps({"by": keys.name, "commands": commands, "signature": signature}) + "\n"


def parse_signature(text: str) -> SignedSummary:
    """The inverse of `signature_of`; raises ValueError."""
    try:
        data = json.loads(text)
        found = SignedSummary(
            str(data["by"]), str(data["commands"]), bytes.fromhex(data["signature"])
        )
    except (TypeError, KeyError, RecursionError) as error:
        raise ValueError(f"it is malformed: {error!r}") from None
    return found


def _content(run: str, summary: bytes, commands: str) -> bytes:
    return b"mrbt summary\0" + json.dumps([run, commands]).encode() + b"\0" + summary
