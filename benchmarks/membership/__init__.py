"""How membership and agreement fare on networks from good to hopeless: docs/membership.md."""
