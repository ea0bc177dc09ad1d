"""From facts and the alive set to a plan: `make_plan.make_plan`, read from top to bottom.

Imports `facts` and what is below, never `membership`.
"""
