"""Reads boards on other machines over Zenoh; see docs/zenoh.md."""

from ..errors import missing

try:
    import zenoh  # noqa: F401
except ImportError:
    raise missing("boards on other machines need", "Zenoh", "zenoh") from None
