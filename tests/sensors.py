"""Variants of a sensor file."""

import msgspec


def replaced(sensor, **parts):
    """Return the sensor with fields of its parts replaced, as ``led={"noise_ppm_10ms": 0}``."""
    return msgspec.structs.replace(
        sensor,
        **{
            name: msgspec.structs.replace(getattr(sensor, name), **fields)
            for name, fields in parts.items()
        },
    )
