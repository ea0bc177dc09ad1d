"""commands.jsonl: the commands that operators gave by commands and views, for reports.

Each line has a hash of the line before it. In a team with keys, the operator whose key is in the
run directory signs each line, so no line can be added, changed, or removed from the middle without
that key; the number of lines at the end is signed with the summary.
"""

from __future__ import annotations

import errno
import fcntl
import hashlib
import json
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mrbt_mesh.core.membership.keys import Role
from mrbt_mesh.errors import InputError
from mrbt_mesh.recording.folder import open_regular
from mrbt_mesh.runtime.job_requests import MAX_UNIX_US
from mrbt_mesh.runtime.private_files import private_opener
from mrbt_mesh.runtime.run_dir import COMMANDS_FILE, RunDir, RunDirError

# Files of a run beside its recordings are refused if they are larger.
MOST_BYTES = 1 << 28

if TYPE_CHECKING:
    from mrbt_mesh.runtime.member_keys import Manifest, MemberKeys

HASH_BYTES = 16
DOWN = "mrbt down"
CONTINUE = "mrbt up --continue"


@dataclass(frozen=True)
class NotedCommand:
    """One line of the file.

    `signer` is who signed it, empty if the signature is not proved. `problem` says why it does not
    follow the line before it, or is not what was signed. `unix_s` is None for a malformed line.
    """

    number: int
    unix_s: float | None
    by: str
    command: str
    signer: str = ""
    problem: str = ""


def note_command(run_dir: RunDir, by: str, command: str, unix_s: float | None = None) -> None:
    """Note an operator's command: the command or view that gave it, what it was, and when (now).

    Raises RunDirError if it cannot be noted; the command itself was carried out.
    """
    path = run_dir.path / COMMANDS_FILE
    data = {"unix_s": unix_s or time.time(), "by": by, "command": command}
    try:
        keys = _operator(run_dir)
        run = run_dir.info().run if keys is not None else ""
        with open(path, "a+b", opener=private_opener) as file:
            # Several processes give commands.
            fcntl.flock(file, fcntl.LOCK_EX)
            file.seek(0)
            content = file.read()
            begin = b"\n" if content and not content.endswith(b"\n") else b""
            file.write(begin + _line(data, _lines(content)[-1:], keys, run))
    except (OSError, InputError) as error:
        reason = getattr(error, "strerror", None) or error
        raise RunDirError(f"{path}: the command is not noted for reports: {reason}") from error


def check_signer(run_dir: RunDir) -> None:
    """Raise KeysError if the operator's key is refused, so that nothing is done and not noted."""
    _operator(run_dir)


@dataclass(frozen=True)
class TeamEnd:
    """An operator has ended the team by `mrbt down`.

    `text` describes it; `until_unix_s` is when the next command was given, which may have continued
    the team; None if there was none.
    """

    text: str
    unix_s: float
    until_unix_s: float | None


def team_ends(run_dir: RunDir) -> list[TeamEnd]:
    """Return all ends of the team by a command, in order."""
    try:
        content = (run_dir.path / COMMANDS_FILE).read_bytes()
    except OSError:
        return []
    noted = [(n.by, n.command, n.unix_s) for n in noted_commands(content, "", None) if n.unix_s]
    following: list[float | None] = [*(unix_s for _, _, unix_s in noted[1:]), None]
    return [
        TeamEnd(command, unix_s, until_s)
        for (by, command, unix_s), until_s in zip(noted, following, strict=False)
        if by == DOWN
    ]


def last_end(run_dir: RunDir) -> TeamEnd | None:
    """Return the last end by `mrbt down`.

    None if there is none, or if a command was given since.
    """
    ends = team_ends(run_dir)
    return ends[-1] if ends and ends[-1].until_unix_s is None else None


def read_regular(path: Path) -> bytes:
    """Read another file of a run whole. Raises OSError, also for one of more than `MOST_BYTES`."""
    with open_regular(path) as file:
        content = file.read(MOST_BYTES + 1)
    if len(content) > MOST_BYTES:
        raise OSError(errno.EFBIG, f"it is larger than {MOST_BYTES >> 20} MiB", str(path))
    return content


def read_commands(path: Path) -> bytes | None:
    """Return the content of the file, or None if there is none. Raises OSError."""
    return read_regular(path) if path.exists() else None


def head_of(content: bytes | None) -> str:
    """Return the hash of the last line, which depends on all lines before.

    Empty if there is none.
    """
    lines = _lines(content)
    return _hash(lines[-1]) if lines else ""


def heads(content: bytes | None) -> list[str]:
    """Return all heads that the file had while it grew, starting with the empty one."""
    return ["", *map(_hash, _lines(content))]


def noted_commands(content: bytes, run: str, manifest: Manifest | None) -> Iterator[NotedCommand]:
    """Yield the lines of the file; `manifest` checks their signatures."""
    before, lines = b"", _lines(content)
    for number, line in enumerate(lines, start=1):
        noted = _noted(number, line, before, run, manifest)
        if number == len(lines) and not content.endswith(b"\n") and not noted.problem:
            noted = replace(noted, signer="", problem="lacks its newline")
        yield noted
        before = line


def _operator(run_dir: RunDir) -> MemberKeys | None:
    """Return the operator's keys in the run directory.

    None without keys, or without an operator's; the line is then not signed, and `verify` says so.
    Raises KeysError for a key that cannot be used.
    """
    if not run_dir.keys_path.is_dir():
        return None
    # Imported here, so that a signal to a robot does not wait for the signing library.
    from mrbt_mesh.runtime.key_folder import KeyFolder

    folder = KeyFolder(run_dir.keys_path)
    try:
        reader = folder.reader()
    except InputError:
        return None
    keys = folder.keys_of(reader)
    return keys if keys.role_of(keys.name) is Role.OPERATOR else None


def _lines(content: bytes | None) -> list[bytes]:
    """Return the lines without their ends, which are newlines alone: other ends are a change."""
    lines = (content or b"").split(b"\n")
    return lines if lines[-1] else lines[:-1]


def _line(
    data: dict[str, Any], before: Sequence[bytes], keys: MemberKeys | None, run: str
) -> bytes:
    """Return a line after the one `before`, or the first one."""
    data = {**data, "after": _hash(before[0]) if before else ""}
    if keys is not None:
        signature = keys.sign(_content(run, data)).hex()
        data = {**data, "signer": keys.name, "signature": signature}
    return json.dumps(data).encode() + b"\n"


def _noted(
    number: int, line: bytes, before: bytes, run: str, manifest: Manifest | None
) -> NotedCommand:
    from mrbt_mesh.runtime.member_keys import was_signed

    try:
        data = json.loads(line)
        known = NotedCommand(number, float(data["unix_s"]), str(data["by"]), str(data["command"]))
        signed = {name: data[name] for name in ("unix_s", "by", "command", "after")}
        signer, signature = data.get("signer", ""), data.get("signature", "")
        again = signed | ({"signer": signer, "signature": signature} if signer else {})
        is_whole = json.dumps(again).encode() == line
        proof = bytes.fromhex(signature)
        if not 0 <= float(data["unix_s"]) <= MAX_UNIX_US / 1e6:
            raise ValueError("no clock shows this")
    except (ValueError, TypeError, KeyError, AttributeError, OverflowError, RecursionError):
        return NotedCommand(number, None, "", "", problem="is not a command that mrbt has noted")
    problem = ""
    if not is_whole:
        problem = "is not as mrbt writes it"
    elif data["after"] != (_hash(before) if before else ""):
        problem = "does not follow the line before it"
    elif (
        manifest is not None
        and signer
        and not was_signed(manifest, signer, _content(run, signed), proof, Role.OPERATOR)
    ):
        problem = f"was not signed by {signer}"
    is_proved = bool(signer) and manifest is not None and not problem
    return NotedCommand(
        number, known.unix_s, known.by, known.command, signer if is_proved else "", problem
    )


def _hash(line: bytes) -> str:
    return hashlib.blake2b(line, digest_size=HASH_BYTES).hexdigest()


def _content(run: str, data: dict[str, Any]) -> bytes:
    return b"mrbt command\0" + run.encode() + b"\0" + json.dumps(data).encode()
