"""What must always hold, checked while a run goes on: one class per invariant.

I1 same facts and same alive set give the same plan; I2 facts converge; I3 nothing that is done is
undone; I4 nobody works on what it cannot do, and at rest the bounds of every demand hold; I5 an
exclusive task has one coalition at a time, and is not begun again; I6 what can be finished is
finished; I7 assignments are optimal and canonical, by the bids of all living robots, and every
plan is that of the definitions; I8 garbage changes nothing; I9 a restart resumes from the journal.

`checkers` calls each of them, `findings` notes what they find. Imports `world`, which knows nothing
of them. A checker evaluates and plans by the definitions.
"""
