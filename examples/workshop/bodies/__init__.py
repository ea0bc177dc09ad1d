"""Bodies of robots in MuJoCo, and what programs and worlds share (docs/how-to/workshop.md).

`messages` and `link` are known to both sides; `physics` is the world's, `body` and `driving` are
the robots'.
"""
