"""Items with the version at which each has changed last, so that whoever falls behind is told the
newest of each item, and never a queue of old ones.
"""

from __future__ import annotations

from collections import OrderedDict
from typing import Any


class ChangeLog:
    """Key -> newest value. `version` grows by one with every change; 0: nothing was said yet.

    A value is plain data and is not changed once it was put. None says that the item is gone.
    """

    def __init__(self) -> None:
        self.version = 0
        # The latest changed last.
        self._items: OrderedDict[str, tuple[int, Any]] = OrderedDict()

    def put(self, key: str, value: Any) -> bool:
        """Whether that is another value than before."""
        known = self._items.get(key)
        if (known is None and value is None) or (known is not None and known[1] == value):
            return False
        self.version += 1
        self._items[key] = self.version, value
        self._items.move_to_end(key)
        return True

    def since(self, version: int) -> dict[str, Any]:
        """What has changed after `version`, oldest first; after 0: everything there is."""
        found: dict[str, Any] = {}
        for key, (changed, value) in reversed(self._items.items()):
            if changed <= version:
                break
            if version > 0 or value is not None:
                found[key] = value
        return dict(reversed(found.items()))
