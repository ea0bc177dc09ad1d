"""Items with the version of their last change: a slow reader gets the newest of each item, never a
queue of old ones.
"""

from __future__ import annotations

from collections import OrderedDict
from typing import Any


class ChangeLog:
    """Key -> newest value. `version` grows by one with every change; 0: nothing was put yet.

    A value is plain data, never changed after it was put. None removes the item.
    """

    def __init__(self) -> None:
        self.version = 0
        # The latest changed last.
        self._items: OrderedDict[str, tuple[int, Any]] = OrderedDict()

    def put(self, key: str, value: Any) -> bool:
        """Put a value; whether it differs from the one before."""
        known = self._items.get(key)
        if (known is None and value is None) or (known is not None and known[1] == value):
            return False
        self.version += 1
        self._items[key] = self.version, value
        self._items.move_to_end(key)
        return True

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
