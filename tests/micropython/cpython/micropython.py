"""A substitute for MicroPython's own module in CPython, where no heap can be locked."""


def const(value):
    return value


def heap_lock():
    pass


def heap_unlock():
    pass
