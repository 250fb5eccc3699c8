"""Prints how many bits a small integer of this machine holds, its sign not counted."""

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
