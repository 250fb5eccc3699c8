"""Publishes boards over Zenoh, and reads boards on other machines; see docs/zenoh.md."""

from ..errors import missing

try:
    import zenoh  # noqa: F401
except ImportError:
    raise missing("'spots publish' and remote boards need", "Zenoh", "zenoh") from None
