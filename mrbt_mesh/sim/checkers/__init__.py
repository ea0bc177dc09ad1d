"""The invariants, checked during a run: one function for each, or a class if it keeps an account.

I1 same facts and same alive set give the same plan; I2 facts converge; I3 nothing that is done is
undone; I4 nobody works on what it cannot do, and at rest the bounds of every demand hold; I5 an
exclusive task has one coalition at a time, and does not begin again; I6 what can be finished is
finished; I7 assignments are optimal and canonical, by the bids of all living robots, and every
plan is that of the definitions; I8 garbage changes nothing; I9 a restart resumes from the journal;
I10 no acknowledged job is lost.

`checkers` calls each of them. The package imports `world`, which does not know it. A checker
evaluates and plans by the definitions.
"""
