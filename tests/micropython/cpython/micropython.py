"""What the scripts ask of MicroPython's own module, for CPython, where no heap can be locked."""


def const(value):
    return value


def heap_lock():
    pass


def heap_unlock():
    pass
