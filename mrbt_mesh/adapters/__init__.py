"""Adapters to other programs: their protocols and file formats."""
