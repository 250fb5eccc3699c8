"""What a program on the host makes of readings: controllers, keyboards, encoders, a twin."""
