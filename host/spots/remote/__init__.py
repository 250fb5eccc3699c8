"""Boards on other machines, over Zenoh; see docs/zenoh.md."""
