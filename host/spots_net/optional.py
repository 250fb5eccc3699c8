"""Zenoh, which is an optional package: without it, the import of this module raises SpotsError."""

from spots.errors import missing

try:
    import zenoh as zenoh
except ImportError:
    raise missing("'spots publish' and remote boards need", "Zenoh", "zenoh") from None
