"""The command `mrbt`: a module for each group of commands, with what they do.

`main` has the list of commands, `command` what is added to click, `options` and `network` the
options that several commands share, `plugged` those that plug-ins add, `views` what people see.

A command's module is imported for its help alone too, so it imports what it works with when it is
called: `mrbt kill` must not wait for what plans.
"""
