"""What differs between the runtimes: one module each."""
