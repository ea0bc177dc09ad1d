"""Membership and agreement on good and bad networks: docs/explanation/membership.md."""
