"""Wrong input: the one kind of error that every command tells as a message."""


class InputError(Exception):
    """Something that a person wrote is wrong: the message says where, and what would be right.

    Commands print it and end with exit status 2. Each package derives its own errors from it.
    """
