"""Deliberate bugs of the feature: each must break its invariant."""

from __future__ import annotations

from dataclasses import replace

from mrbt_mesh.features.bids import plan

MUTANTS = {
    # The plan takes the bids that there are; robots without a bid are the last resort.
    "bids_not_awaited": (
        plan,
        "_bidding",
        lambda original, *given: replace(original(*given), is_open=False),
    ),
}
