"""Substitute in CPython for the module `micropython`; its functions do not lock the heap."""


def heap_lock():
    pass


def heap_unlock():
    pass
