"""The canonical optimum brought up to date along shortest augmenting paths (`assignment.solve`)."""
