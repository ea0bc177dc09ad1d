"""What a team knows: kinds of entries, the map that joins, how a team reads it, coalitions.

Imports `mission` and what is below. Joining is commutative, associative and idempotent; whatever is
read from it is the same for the same entries, in whichever order they came.
"""
