"""What only makes the core faster: the same answers as the definitions, after a change.

Each part has the interface of the definition whose place it takes, and is held against it by tests
and by chaos. Imported in one place, `core.engine`; without it (MRBT_PLAIN=1) everything still runs.
"""
