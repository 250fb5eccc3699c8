"""Keyboards and gamepads of this computer that an application controls."""
