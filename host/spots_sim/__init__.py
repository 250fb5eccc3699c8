"""Simulated strip, chip and board. The chip shares no code with the firmware's driver."""
