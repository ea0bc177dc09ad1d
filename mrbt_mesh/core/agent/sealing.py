"""Seals what an agent sends and opens what it receives, in a team with keys."""

from __future__ import annotations

from dataclasses import replace

from mrbt_mesh.core.agent.effects import Ask, Effect, Publish, Reply
from mrbt_mesh.core.agent.inputs import (
    AnswerReceived,
    FromOutside,
    MessageReceived,
    QueryReceived,
)
from mrbt_mesh.core.membership.envelope import Guard, StaleError
from mrbt_mesh.core.membership.keys import Keys, Role
from mrbt_mesh.core.membership.wire import MessageKind

MAX_ASKERS = 1_000


class Sealing:
    """A guard for one agent. It remembers who sent each query, as only the sender may read the
    answer.

    For `life` see `Guard`.
    """

    def __init__(self, keys: Keys, run: str, life: int) -> None:
        self.guard = Guard(keys, run, life)
        self._askers: dict[int, str] = {}

    def seal(self, effect: Effect) -> Effect:
        """Return the effect with its message sealed, or unchanged if it has none."""
        match effect:
            case Publish(_, data, to):
                readers = (*to, *self._watchers()) if to is not None else None
                return replace(effect, data=self.guard.seal(data, readers))
            case Ask():
                return replace(effect, data=self.guard.seal(effect.data, (effect.peer,)))
            case Reply():
                asker = self._askers.pop(effect.query, None)
                if asker is not None:
                    pages = tuple([self.guard.seal(page, (asker,)) for page in effect.pages])
                    return replace(effect, pages=pages)
        return effect

    def _watchers(self) -> list[str]:
        """Members other than robots, who may read messages even if these go to some robots only."""
        keys = self.guard.keys
        return [name for name in keys.members() if keys.role_of(name) is not Role.ROBOT]

    def open(self, event: FromOutside) -> FromOutside:
        """Return the input with any message in it opened. Raises WireError."""
        match event:
            case MessageReceived(kind, source, data, envelope):
                _, inner = self.guard.open(data, kind, source, envelope)
                return MessageReceived(kind, source, inner)
            case QueryReceived(query, kind, data):
                try:
                    asker, inner = self.guard.open(data, kind)
                except StaleError as error:
                    self._note_asker(query, error.sender)
                    raise
                self._note_asker(query, asker)
                return QueryReceived(query, kind, inner)
            case AnswerReceived(peer, data) if data is not None:
                _, inner = self.guard.open(data, MessageKind.STATE, peer)
                return AnswerReceived(peer, inner)
        return event

    def _note_asker(self, query: int, asker: str) -> None:
        while len(self._askers) >= MAX_ASKERS:
            del self._askers[min(self._askers)]
        self._askers[query] = asker
