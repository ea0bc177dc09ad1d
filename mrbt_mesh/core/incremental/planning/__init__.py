"""The steps of a plan, each using what has not changed since the plan before (`planning.steps`)."""
