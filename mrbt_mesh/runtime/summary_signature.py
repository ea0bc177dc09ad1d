"""The signature of a run's summary.json, by the observer that wrote it.

It also covers the number of commands noted by then, and the recordings that existed: of one whose
writer had ended, to its last record.
"""

from __future__ import annotations

import json
from dataclasses import dataclass

from mrbt_mesh.core.membership.keys import Keys, Role
from mrbt_mesh.recording.folder import first_parts, observer_files, robot_files
from mrbt_mesh.recording.metadata import NamedRecording, pack_named, parse_named
from mrbt_mesh.recording.reader import named
from mrbt_mesh.runtime.command_log import head_of, read_commands
from mrbt_mesh.runtime.key_folder import KeyFolder
from mrbt_mesh.runtime.member_keys import Manifest, was_signed
from mrbt_mesh.runtime.run_dir import (
    COMMANDS_FILE,
    SIGNATURE_FILE,
    SUMMARY_FILE,
    RunDir,
    RunDirError,
    write_atomically,
)

_OTHER_TEXT = "it is not as mrbt writes it"


def sign_summary(run_dir: RunDir) -> None:
    """Sign the written summary, in a team with keys. Raises KeysError, RunDirError."""
    if not run_dir.keys_path.is_dir():
        return
    folder, path = KeyFolder(run_dir.keys_path), run_dir.path / SIGNATURE_FILE
    keys = folder.keys_of(folder.reader())
    try:
        summary = (run_dir.path / SUMMARY_FILE).read_bytes()
        commands = head_of(read_commands(run_dir.path / COMMANDS_FILE))
        files = first_parts([*observer_files(run_dir.path), *robot_files(run_dir.path)])
        run = run_dir.info().run
        covered = Covered(run, commands, named(files, run, run_dir.robots()))
        write_atomically(path, signature_of(keys, summary, covered))
    except OSError as error:
        raise RunDirError(f"{path} cannot be written: {error.strerror or error}") from error


@dataclass(frozen=True)
class Covered:
    """What is signed together with the summary.

    That is the run, the hash of the last command noted by then, and how far the recordings in the
    run directory had been written.
    """

    run: str
    commands: str = ""
    recordings: tuple[NamedRecording, ...] = ()

    def content(self, summary: bytes) -> bytes:
        """Return the bytes that are signed."""
        text = json.dumps([self.run, self.commands, pack_named(self.recordings)])
        return b"mrbt summary\0" + text.encode() + b"\0" + summary


@dataclass(frozen=True)
class SignedSummary:
    """The content of the signature's file."""

    by: str
    covered: Covered
    signature: bytes

    def to_text(self) -> str:
        """Return the content of the signature's file."""
        data = {
            "by": self.by,
            "commands": self.covered.commands,
            "recordings": pack_named(self.covered.recordings),
            "signature": self.signature.hex(),
        }
        return json.dumps(data) + "\n"

    def is_for(self, manifest: Manifest, summary: bytes) -> bool:
        """Return whether an operator or observer of the team has signed this summary."""
        content = self.covered.content(summary)
        roles = (Role.OPERATOR, Role.OBSERVER)
        return any(was_signed(manifest, self.by, content, self.signature, role) for role in roles)


def signature_of(keys: Keys, summary: bytes, covered: Covered) -> str:
    """Return the content of the signature's file."""
    return SignedSummary(keys.name, covered, keys.sign(covered.content(summary))).to_text()


def parse_signature(text: str, run: str) -> SignedSummary:
    """The inverse of `signature_of`; raises ValueError."""
    try:
        data = json.loads(text)
        recordings = parse_named(data["recordings"])
        covered = Covered(run, str(data["commands"]), recordings)
        found = SignedSummary(str(data["by"]), covered, bytes.fromhex(data["signature"]))
    except (ValueError, TypeError, KeyError, RecursionError):
        raise ValueError(_OTHER_TEXT) from None
    if found.to_text() != text:
        raise ValueError(_OTHER_TEXT)
    return found
