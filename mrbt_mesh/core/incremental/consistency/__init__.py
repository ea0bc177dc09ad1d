"""*Check Consistency* brought up to date: a matching and Hall witnesses.

In place of `planning.consistency.kept_requests`: `keeper` and `kept_requests` find out what has
changed, `decisions` decides again only where that may matter, by a `matching` of robots and `slots`
for what is kept and `hall_witnesses` for what cannot be.

Imports `planning` and what is below, nothing else of `incremental`.
"""
