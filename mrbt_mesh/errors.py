"""Wrong input, told as a message by every command; a task that has failed, told with a reason."""


class InputError(Exception):
    """Something that a person wrote is wrong: the message says where, and what would be right.

    Commands print it and end with exit status 2. Each package derives its own errors from it.
    """


class TaskFailedError(Exception):
    """Raise it in a local task, or in a leaf of a tree, to report failure with a reason.

    There is no traceback in the log.
    """
