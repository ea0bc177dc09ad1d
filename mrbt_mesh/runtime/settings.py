"""Names and defaults that robots and commands share. Importing it loads nothing else."""

from __future__ import annotations

DEFAULT_BEAT_S, DEFAULT_DETECTION_S = 0.2, 1.0
# How long the first robot of a team waits for the other robots to start.
DEFAULT_GATHER_S = 10.0
DEFAULT_ALONE_AFTER_S = 30.0
# Start time per robot of a large team whose robots all run on one machine.
START_S_PER_ROBOT = 0.5
# The size at which a robot's files are rotated, or end (`limited_file`, `recording`).
MIB, DEFAULT_KEEP_MIB = 1 << 20, 256
# Environment variables for the options of the same names.
MISSION_VARIABLE, TEAM_VARIABLE, RUN_VARIABLE = "MRBT_MISSION", "MRBT_TEAM", "MRBT_RUN"
ROUTER_VARIABLE = "MRBT_ROUTER"
KEYS_VARIABLE = "MRBT_KEYS"
# The prefix of warnings on stderr.
WARNING = "mrbt: warning:"

WIRED, WIRELESS = "wired", "wireless"
# Transport profile -> protocols of its endpoints; see docs/how-to/network.md.
PROTOCOLS = {WIRED: ("tcp", "tls"), WIRELESS: ("quic",)}
ENCRYPTED = frozenset({"tls", "quic"})


def default_protocol(profile: str, has_certificates: bool) -> str:
    """Return the protocol of a link whose endpoint is not given: encrypted if possible."""
    return PROTOCOLS[profile][-1 if has_certificates else 0]
