"""In place of the bridge's program where there is no ROS: it says what it is asked to say.

`say` has it send that message, `end` has it end, `freeze` has it stand still. Everything else it
hears it sends back.
"""

from __future__ import annotations

import os
import signal
import sys

import msgpack


def main() -> None:
    """Serve until the pipe ends."""
    unpacker = msgpack.Unpacker()
    sys.stderr.write("[WARN] a line of ROS\n")
    sys.stderr.flush()
    while chunk := os.read(0, 65_536):
        unpacker.feed(chunk)
        for message in unpacker:
            if message.get("op") == "end":
                os._exit(3)
            if message.get("op") == "freeze":
                signal.pause()
            said = message.get("say", {"op": "echo", "message": message})
            os.write(1, msgpack.packb(said))
    sys.stderr.write("the pipe has ended\n")


if __name__ == "__main__":
    main()
