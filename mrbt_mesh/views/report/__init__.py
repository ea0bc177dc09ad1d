"""The figures of a report on runs, from their recordings or from what commands told of them.

`recorded` and `told` make `model`'s figures; how they look is for the command line.
"""
