"""Recordings read again: shown (`shown_recording`), verified (`verify`), continued (`what_if`).

`verify` makes every plan again from the recorded facts, with the plain definitions, and compares
the recordings of one run. This package may import the simulator.
"""
