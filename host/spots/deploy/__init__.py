"""Builds, flashes, erases and checks the firmware of a board."""
