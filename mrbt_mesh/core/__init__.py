"""The pure core: facts and time come in as arguments, effects go out as data.

No clock, no randomness, no I/O. Packages, each of which may import only those below it:

    agent | observer         one robot; a passive observer
    engine                   the functions that agents and observers use
    planning | membership    plans; the alive set
    facts                    what the team knows, and how it joins
    mission                  robots, tasks, side constraints
    bt | assignment          behavior trees; the assignment problem
"""
