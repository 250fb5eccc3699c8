"""Keys, frames and commands over Bluetooth LE, on a board whose runtime has `bluetooth`."""
