"""What a host program makes of readings: a controller, and the devices that it plays."""
