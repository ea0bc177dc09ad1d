"""The command `mrbt`: its commands, and what they share.

`main` lists the commands and `command` extends click. `options` and `network` define options that
several commands share, `plugged` those that plug-ins add. `views` draws for people.

A command's module is imported even for its help, so it imports its tools only when it is called:
`mrbt kill` must not wait for the planner.
"""
