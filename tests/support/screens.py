"""Sizes of screens on which the page is tested."""

from __future__ import annotations

SCREENS = {"desk": (1440, 900), "phone": (390, 844), "lying phone": (844, 390)}
