"""Publishes boards over Zenoh, and reads boards on other machines; see docs/lab/zenoh.md."""
