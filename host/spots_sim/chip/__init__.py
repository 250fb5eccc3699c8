"""The AS7341 at register level, and the I2C bus."""
