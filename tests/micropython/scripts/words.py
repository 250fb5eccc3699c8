"""Prints the number of bits of a small integer in this MicroPython, without the sign bit."""

from locked import locked


def grow(numbers, bits):
    while bits[0] < 100:
        numbers[0] = numbers[0] + numbers[0] + 1
        bits[0] += 1


bits = [0]
try:
    locked(grow, [0], bits)
except MemoryError:
    pass
print(bits[0])
