"""The link to a board: decoder, serial port, clock, reconnect."""
