"""Recordings read again: as they were (`player`), as they must have been (`verify`), as they might
have gone on (`what_if`).

`verify` trusts nothing that stands in a recording: it makes every plan again from the recorded
facts, with the plain definitions, and compares what the robots of one run have recorded.

It may import the simulator and what is below.
"""
