"""Switches the radio on, on a board whose stored setting ``radio`` says so."""

_OFF = "off"


def attach(board, serial, usb, bluetooth=None):
    """Return what stands in place of serial port and USB stack: with the radio off, these.

    Parameters
    ----------
    board : app.Board
        The board, whose `radio` is set.
    serial, usb : object
        As `app.Board` takes them.
    bluetooth : module, optional
        In place of MicroPython's ``bluetooth``.
    """
    use = _OFF
    for line in board.store.load("settings"):
        if line.startswith("radio="):
            use = line[6:]
    if use == _OFF:
        return serial, usb
    if bluetooth is None:
        import bluetooth
    from .wireless import Wireless

    board.radio = Wireless(board, bluetooth, use, serial, usb)
    return board.radio.ports, board.radio.keys
