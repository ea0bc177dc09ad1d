"""Through how many files one event goes: what a reader has to open to follow it (`python -m benchmarks.walk`)."""
