"""A SPOTS strip as a teleoperator of LeRobot."""

from .spots_teleoperator import SpotsTeleoperator, SpotsTeleoperatorConfig

__all__ = ["SpotsTeleoperator", "SpotsTeleoperatorConfig"]
