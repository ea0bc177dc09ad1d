"""The command `mrbt`.

`commands` has a file for each command: what it takes, and what it is for. What a command does is in
`team` (robots' processes and words to robots), `virtual` (runs in virtual time) and `trees` (files
of trees). `views` draws what people see, from data alone; `missions` and `options` are what several
commands need. `framework` makes commands out of functions, and knows none of them.

A command's file is imported for its help screen alone, so it imports what it works with when it is
called: `mrbt kill` must not wait for what plans.
"""
