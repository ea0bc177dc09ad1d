"""The signature of a run's summary.json, by the observer that wrote it.

It also covers the number of commands noted by then, and the recordings that existed: of one whose
writer had ended, to its last record. One that was made after the run's end says when: it proves
nothing about what was changed in between.
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
from mrbt_mesh.runtime.member_keys import Manifest, MemberKeys, was_signed
from mrbt_mesh.runtime.run_dir import (
    COMMANDS_FILE,
    SIGNATURE_FILE,
    SUMMARY_FILE,
    RunDir,
    RunDirError,
    write_atomically,
)

# What the calendar of `datetime` can show.
_MOST_UNIX_S = 253_402_300_799
_OTHER_TEXT = "it is not as mrbt writes it"


def summary_keys(run_dir: RunDir) -> MemberKeys | None:
    """Return the keys that sign a summary, None for a team without keys. Raises KeysError."""
    if not run_dir.keys_path.is_dir():
        return None
    folder = KeyFolder(run_dir.keys_path)
    return folder.keys_of(folder.reader())


def sign_summary(run_dir: RunDir, afterwards_unix_s: int | None = None) -> None:
    """Sign the written summary, in a team with keys. Raises KeysError, RunDirError.

    `afterwards_unix_s`: the time now, if the run's end was not witnessed.
    """
    keys, path = summary_keys(run_dir), run_dir.path / SIGNATURE_FILE
    if keys is None:
        return
    try:
        summary = (run_dir.path / SUMMARY_FILE).read_bytes()
        commands = head_of(read_commands(run_dir.path / COMMANDS_FILE))
        files = first_parts([*observer_files(run_dir.path), *robot_files(run_dir.path)])
        run = run_dir.info().run
        covered = Covered(run, commands, named(files, run, run_dir.robots()), afterwards_unix_s)
        write_atomically(path, signature_of(keys, summary, covered))
    except OSError as error:
        raise RunDirError(f"{path} cannot be written: {error.strerror or error}") from error


def is_closed(run_dir: RunDir) -> bool:
    """Return whether the run has a summary that was signed at its end, if it has keys.

    Raises KeysError, RunDirError.
    """
    keys = summary_keys(run_dir)
    if keys is None:
        return run_dir.summary() is not None
    try:
        summary = (run_dir.path / SUMMARY_FILE).read_bytes()
        text = (run_dir.path / SIGNATURE_FILE).read_text(encoding="utf-8")
        found = parse_signature(text, run_dir.info().run)
    except (OSError, ValueError):
        return False
    return found.covered.is_of_the_end and found.is_for(keys.manifest, summary)


@dataclass(frozen=True)
class Covered:
    """What is signed together with the summary.

    That is the run, the hash of the last command noted by then, how far the recordings in the run
    directory had been written, and when it was signed if that was after the run's end.
    """

    run: str
    commands: str = ""
    recordings: tuple[NamedRecording, ...] = ()
    afterwards_unix_s: int | None = None

    @property
    def is_of_the_end(self) -> bool:
        """True if it was signed by a process that had witnessed the end of the run."""
        return self.afterwards_unix_s is None

    def later(self) -> dict[str, int]:
        """Return the field of the signature's file that says that it was made afterwards."""
        at_s = self.afterwards_unix_s
        return {} if at_s is None else {"afterwards_unix_s": at_s}

    def content(self, summary: bytes) -> bytes:
        """Return the bytes that are signed."""
        later = [self.later()] if not self.is_of_the_end else []
        text = json.dumps([self.run, self.commands, pack_named(self.recordings), *later])
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
            **self.covered.later(),
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
        later = data.get("afterwards_unix_s")
        if later is not None and (type(later) is not int or not 0 <= later <= _MOST_UNIX_S):
            raise ValueError(_OTHER_TEXT)
        covered = Covered(run, str(data["commands"]), recordings, later)
        found = SignedSummary(str(data["by"]), covered, bytes.fromhex(data["signature"]))
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
        raise ValueError(_OTHER_TEXT) from None
    if found.to_text() != text:
        raise ValueError(_OTHER_TEXT)
    return found
