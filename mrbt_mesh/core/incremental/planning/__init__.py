"""The steps of a plan, each using what has not changed since the plan before.

In place of `planning.steps.PlanningSteps`: `steps` puts together what keeps capabilities, demands
and bids up to date here, consistency and assignment beside it.

Imports `planning` and what is below, and of `incremental` those two. What has not changed stays the
same object, so that others can tell by looking at it once.
"""
