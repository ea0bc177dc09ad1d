"""Recorded runs: replayed, verified, reported, continued; `mrbt recording`."""
