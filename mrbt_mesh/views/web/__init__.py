"""The live page: a small server beside an observer, and what browsers load from it.

Needs the extra `web`; only `server` and what it imports do.
"""
