"""Checks that code allocates nothing: runs it while the heap is locked."""

import micropython


def locked(function, given, results):
    """Call ``function(given, results)`` while the heap is locked.

    An allocation during the call raises MemoryError.
    """
    micropython.heap_lock()
    try:
        function(given, results)
    finally:
        micropython.heap_unlock()
