"""Substitute in CPython for the module `micropython`; its functions do not lock the heap."""


def const(value):
    return value


def heap_lock():
    pass


def heap_unlock():
    pass
