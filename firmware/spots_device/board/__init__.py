"""The application on the board: loop, commands, settings, start."""
