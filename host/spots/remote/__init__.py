"""Boards on other machines, over Zenoh; see docs/zenoh.md."""

from ..errors import SpotsError

try:
    import zenoh  # noqa: F401
except ImportError:
    raise SpotsError(
        "boards on other machines need another package: pip install 'spots-tactile[zenoh]'"
    ) from None
