"""The port virtual, and the demonstrations."""
