"""Records the bytes of a link, and reads recordings; see docs/program/recording-format.md."""
