"""Deliberate bugs of the feature: each must break its invariant."""

from __future__ import annotations

from mrbt_mesh.features.contact.watch import ContactWatch

MUTANTS = {
    # Robots begin as soon as they take others for dead, which may still be at work without contact.
    "those_without_contact_have_stopped": (ContactWatch, "_stops_us", lambda *_, **__: 0),
}
