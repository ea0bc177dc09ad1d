"""Through how many files one event goes: what a reader has to open to follow it.

Run it with `python -m benchmarks.walk`.
"""
