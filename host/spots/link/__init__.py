"""Bytes, frames, a connected board: decoder, serial port, clock, reconnect."""
