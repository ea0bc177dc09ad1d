"""What is said of a team that is too large for its machine."""

from __future__ import annotations

from mrbt_mesh.runtime.capacity import BEAT_COST_S, ROBOT_MEMORY_MB, Overload


def overload_line(found: Overload) -> str:
    """In short, for the live view."""
    return (
        f"{found.robots} robots are more than this machine carries (some {found.carried}): "
        "expect a slow team"
    )


def overload_text(found: Overload) -> str:
    """What is too much, by which figures, and what to do."""
    remedies = [f"at most {found.carried} robots (--robots)"]
    if found.enough_beat_s is not None:
        beat, detection = f"--beat {found.enough_beat_s:g}", f"{found.enough_detection_s:g}"
        remedies.append(f"slower beats ({beat} --detection {detection})")
    remedies.append("robots on several machines (mrbt agent)")
    cores = f"{found.cores} core" + "s" * (found.cores > 1)
    return (
        f"{found.robots} robots are more than this machine carries: some {found.carried}, with "
        f"{cores} and {found.free_memory_mb:,} MB of free memory. A robot takes "
        f"{1e3 * BEAT_COST_S:g} ms of a core per beat (every {found.beat_s:g} s) and "
        f"{ROBOT_MEMORY_MB} MB, its program not counted. The team starts all the same, slowly, and "
        f"reacts late. Better: {', '.join(remedies[:-1])}, or {remedies[-1]}."
    )
