"""Recordings: what a link delivered, as it came, with a header and the times; docs/recording.md."""
