"""Takes over a newer manifest while a robot runs: members that were added, replaced or revoked."""

from __future__ import annotations

from mrbt_mesh.errors import InputError
from mrbt_mesh.runtime.key_folder import KeyFolder
from mrbt_mesh.runtime.member_keys import MemberKeys


class ManifestWatch:
    """Looks whether the manifest in a folder has changed. `problem`: why it was not taken over."""

    def __init__(self, folder: KeyFolder, keys: MemberKeys) -> None:
        self.problem = ""
        self._folder = folder
        self._keys = keys
        self._seen = self._stamp()

    @property
    def is_revoked(self) -> bool:
        """Whether this member is none any more, or has another key by now."""
        return self._keys.is_outdated

    def look(self) -> bool:
        """Whether there was something new: it has been taken over, or there is a `problem`."""
        stamp = self._stamp()
        if stamp is None or stamp == self._seen:
            return False
        self._seen = stamp
        before = self._keys.manifest
        try:
            found = self._folder.manifest(before.authority)
        except InputError as error:
            self.problem = str(error)
            return True
        self.problem = ""
        if found.version <= before.version:
            if found == before:
                return False
            self.problem = f"version {found.version} of the manifest is not newer than ours"
            return True
        self._keys.replace(found)
        return True

    def _stamp(self) -> tuple[int, int] | None:
        try:
            status = self._folder.manifest_path.stat()
        except OSError:
            return None
        return status.st_mtime_ns, status.st_ino
