"""The result of one check of ``spots doctor``."""

from typing import NamedTuple


class Finding(NamedTuple):
    """Result of one check of ``spots doctor``.

    Attributes
    ----------
    check : str
        Name of the check.
    ok : bool
        Whether the board passed the check.
    text : str
        What was found and, after a failure, what to do.
    """

    check: str
    ok: bool
    text: str
