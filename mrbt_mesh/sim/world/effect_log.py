"""The effect log: everything that every agent wanted done, as canonical lines.

Two runs of one seed write the same lines, on every machine and under every hash seed.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Mapping
from typing import Any

from mrbt_mesh.core.agent.effects import Ask, Effect, Persist, Publish, Reply


def _digest(data: bytes) -> str:
    return hashlib.blake2b(data, digest_size=8).hexdigest()


def _plain(value: Any) -> Any:
    """Plain data for JSON; bytes as hexadecimal text."""
    if isinstance(value, bytes):
        return value.hex()
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, tuple | list):
        return [_plain(item) for item in value]
    return value


def effect_json(effect: Effect) -> str:
    """One effect as canonical JSON; of messages a digest of their bytes."""
    match effect:
        case Publish(kind, data):
            return f'{{"publish":"{kind}","data":"{_digest(data)}"}}'
        case Persist(entries, at_once, number):
            names = [[entry.author, entry.name, str(entry.version)] for entry in entries]
            return json.dumps(
                {"persist": names, "at_once": at_once, "number": number}, separators=(",", ":")
            )
        case Ask(peer, data):
            return f'{{"ask":"{peer}","data":"{_digest(data)}"}}'
        case Reply(query, pages):
            return f'{{"reply":{query},"data":"{_digest(b"".join(pages))}"}}'
    fields = {f.name: _plain(getattr(effect, f.name)) for f in dataclasses.fields(effect) if f.repr}
    text = {type(effect).__name__: fields}
    return json.dumps(text, sort_keys=True, separators=(",", ":"), default=str)


class EffectLog:
    """Lines of the form `time_us robot {effect}`, and a running digest of them."""

    def __init__(self, keep_lines: bool) -> None:
        self.lines: list[str] = []
        self._keep = keep_lines
        self._hash = hashlib.blake2b(digest_size=16)

    def write(self, now_us: int, robot: str, effect: Effect) -> None:
        """Add one effect."""
        self.note(now_us, robot, effect_json(effect))

    def note(self, now_us: int, robot: str, text: str) -> None:
        """Add one line that is no effect, such as a fault of the schedule."""
        line = f"{now_us} {robot} {text}"
        self._hash.update(line.encode() + b"\n")
        if self._keep:
            self.lines.append(line)

    @property
    def digest(self) -> str:
        """BLAKE2b over all lines so far, 32 hexadecimal digits."""
        return self._hash.hexdigest()
