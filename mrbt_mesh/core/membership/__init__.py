"""Who is alive, and how robots come to hold the same facts: heartbeats, failure detection, joining,
duplicate ids, leases, anti-entropy, and the messages that all of it goes by.

Imports `facts` and what is below, never `planning`.
"""
