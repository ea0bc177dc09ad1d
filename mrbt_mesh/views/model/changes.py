"""Items with the version of their last change: a slow reader gets the newest of each item, never a
queue of old ones.
"""

from __future__ import annotations

from collections import OrderedDict, deque
from typing import Any

# Of so many items is kept that they were removed: with thousands of jobs each is one.
MOST_REMOVED = 4_096


class ChangeLog:
    """Key -> newest value. `version` grows by one with every change; 0: nothing was put yet.

    A value is plain data, never changed after it was put. None removes the item; a reader who has
    missed more than the last `MOST_REMOVED` of these begins anew (`start_of`).
    """

    def __init__(self) -> None:
        self.version = 0
        # The latest changed last.
        self._items: OrderedDict[str, tuple[int, Any]] = OrderedDict()
        # (version, key) of removals; one whose item has changed since is none any more.
        self._removed: deque[tuple[int, str]] = deque()
        # Removals up to this version are not known any more.
        self._forgotten = 0

    def put(self, key: str, value: Any) -> bool:
        """Put a value; whether it differs from the one before."""
        known = self._items.get(key)
        if (known is None and value is None) or (known is not None and known[1] == value):
            return False
        self.version += 1
        self._items[key] = self.version, value
        self._items.move_to_end(key)
        if value is None:
            self._removed.append((self.version, key))
            if len(self._removed) > MOST_REMOVED:
                self._forget(*self._removed.popleft())
        return True

    def _forget(self, version: int, key: str) -> None:
        """Forget that an item was removed, unless it has changed since."""
        if self._items.get(key) == (version, None):
            del self._items[key]
            self._forgotten = version

    def start_of(self, version: int) -> int:
        """What a reader of this version asks for: 0, so all there is, in place of what he has, if
        not all is known that was removed since.
        """
        return 0 if version < self._forgotten else version

    def drop(self, key: str) -> None:
        """Forget an item that readers drop by themselves: this is no change."""
        self._items.pop(key, None)

    def since(self, version: int) -> dict[str, Any]:
        """What has changed after `version`, oldest first; after 0: everything there is."""
        found: dict[str, Any] = {}
        for key, (changed, value) in reversed(self._items.items()):
            if changed <= version:
                break
            if version > 0 or value is not None:
                found[key] = value
        return dict(reversed(found.items()))
