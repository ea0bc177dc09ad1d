"""What people are shown of a team, as plain data that JSON can carry; pages and terminals draw it.

It reads an `Observer` and is given the time; it imports `core` and `formats` alone.
"""
