"""The version of this package. Importing it loads nothing else of it."""

__version__ = "0.1.0"
