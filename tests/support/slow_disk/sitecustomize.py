"""Put on PYTHONPATH, it gives every process a disk on which a journal's sync takes its time."""

import os
import time

from mrbt_mesh.runtime.journal import Journal

_write = Journal.write


def _write_slowly(self, changes):
    time.sleep(float(os.environ["MRBT_TEST_SYNC_S"]))
    _write(self, changes)


Journal.write = _write_slowly
