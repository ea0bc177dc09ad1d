"""A log of changed items, which keeps only the newest value of each.

A slow reader gets the newest value of each item, never a queue of old ones.
"""

from __future__ import annotations

from collections import OrderedDict, deque
from typing import Any

# The most removals that are remembered; with thousands of jobs, each of them is an item.
MOST_REMOVED = 4_096


class ChangeLog:
    """Maps keys to their newest values. `version` grows by one with every change; 0: still empty.

    A value is plain data that never changes after it was put. None removes the item; a reader who
    has missed more than the last `MOST_REMOVED` removals starts again (`start_of`).
    """

    def __init__(self) -> None:
        self.version = 0
        # Ordered by their last change, the latest last.
        self._items: OrderedDict[str, tuple[int, Any]] = OrderedDict()
        # (version, key) of removals; void if the item has changed since.
        self._removed: deque[tuple[int, str]] = deque()
        # Removals up to this version are forgotten.
        self._forgotten = 0

    def put(self, key: str, value: Any) -> bool:
        """Put a value. Returns whether it differs from the previous one."""
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
        """Return the version that a reader of `version` should ask `since`.

        It is 0, for everything in place of the reader's items, if removals after `version` are
        forgotten.
        """
        return 0 if version < self._forgotten else version

    def drop(self, key: str) -> None:
        """Forget an item that readers drop by themselves; this is not a change."""
        self._items.pop(key, None)

    def since(self, version: int) -> dict[str, Any]:
        """Return the changes after `version`, oldest first; after 0, all items."""
        found: dict[str, Any] = {}
        for key, (changed, value) in reversed(self._items.items()):
            if changed <= version:
                break
            if version > 0 or value is not None:
                found[key] = value
        return dict(reversed(found.items()))
