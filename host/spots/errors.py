"""What a user can put right."""


class SpotsError(Exception):
    """A mistake or a fault outside the program; the text says what is wrong and what to do.

    The command line prints it as one line and ends with exit code 2.
    """


class PortLostError(SpotsError):
    """The port went away, as that of a board with USB of its own does when it restarts."""


class RefusedError(SpotsError):
    """Another board is where one's own was."""
