"""What all rooms use: TOML, atomic writes, locks, bounded reads, signals, plug-ins."""
