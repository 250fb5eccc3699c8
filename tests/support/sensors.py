"""Makes variants of a sensor file for tests."""

import msgspec


def replaced(sensor, **parts):
    """Return a copy of a sensor with changed fields, such as ``led={"noise_ppm_10ms": 0}``."""
    return msgspec.structs.replace(
        sensor,
        **{
            name: msgspec.structs.replace(getattr(sensor, name), **fields)
            for name, fields in parts.items()
        },
    )
