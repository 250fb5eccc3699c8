"""Records the bytes of a link, and reads recordings; see docs/recording.md."""
