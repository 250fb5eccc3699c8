"""The result of one check of ``spots doctor``."""

from typing import NamedTuple


class Finding(NamedTuple):
    """Result of one check of ``spots doctor``: what was found and, after a failure, what to do."""

    check: str
    ok: bool
    text: str
