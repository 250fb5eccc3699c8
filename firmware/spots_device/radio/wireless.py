"""The radio of a running board: hosts come and go, bonds are stored, some commands are refused."""

from ..reading.decode import FORCE_MN
from ..usb.mouse import set_multipliers
from ..usb.usages import CAPS_LOCK
from .hosts import Keys, Ports
from .peripheral import Radio
from .presses import Presses


class Wireless:
    """Connects a board with its radio.

    Parameters
    ----------
    board : app.Board
        The board.
    bluetooth : module
        MicroPython's ``bluetooth``.
    use : str
        The setting ``radio``, not ``"off"``.
    serial, usb : object
        As `app.Board` takes them.
    """

    def __init__(self, board, bluetooth, use, serial, usb):
        self._board = board
        self._radio = radio = Radio(
            bluetooth.BLE(),
            bluetooth.UUID,
            board.uid,
            use,
            board.clock,
            board.store.load("bonds"),
            self._show_leds,
            set_multipliers,
        )
        self.ports = Ports(serial, radio, board.clock)
        self.keys = Keys(usb, radio)
        self.close = radio.close
        self._presses = Presses(board.clock)
        self._shown = False  # whether the LED shows that a host can bond

    @property
    def fault(self):
        """Why one of the two ways does not work although the settings say otherwise, or None."""
        return self._radio.fault or self.keys.fault

    def start(self):
        """Start the radio if no interface of the keys has done so."""
        if not self._radio.opened:
            self._radio.open([])

    def work(self):
        """Follow the events of the stack; called in each pass of the loop."""
        what = self._radio.work()
        if what:
            self._board.release_keys()
            if what == "bonds":
                self._save()
        self.keys.follow(self._board)
        self._follow_presses()
        if self._radio.waits and self._board.interfaces.pump():  # keys before frames
            self._radio.flush()

    def _follow_presses(self):
        # Only while nobody gets the keys: the presses type nothing, and nobody bonds in between.
        radio = self._radio
        if not self.keys.is_heard() and not radio.pairs and not radio.fault:
            force_mN = self._board.strips[0].strip.decode.state[FORCE_MN]
            if self._presses.are_made(force_mN):
                self._pair()
        else:
            self._presses.forget()
        if radio.pairs != self._shown:
            self._shown = radio.pairs
            self._show_leds(CAPS_LOCK if self._shown else 0)

    def _pair(self):
        try:
            self._radio.pair(protected=False)
        except ValueError as error:  # the radio keeps no more hosts
            self._board.log("error", error.args[0])

    def _show_leds(self, leds):
        if self._board.signal:
            self._board.signal(leds)

    def _save(self):
        try:
            self._board.store.save([("bonds", self._radio.bonds.lines())])
        except OSError as error:
            self._board.log("error", "the bond was not stored: %s" % error)

    def refuses(self, name, words):
        """Return whether a command came by radio and must not: it would change who may listen."""
        if not self.ports.by_radio:
            return False
        if name == "radio":
            return words[1:] != ["list"]
        return " radio=" in " " + " ".join(words[1:])

    def order(self, words):
        """Carry out ``list``, ``pair`` or ``forget ADDRESS``; return the reply.

        Raises
        ------
        ValueError
            If the radio has a fault, or the command is wrong.
        """
        radio = self._radio
        if radio.fault:
            raise ValueError(radio.fault, "no_radio")
        verb = words[0] if words else ""
        if verb == "list" and len(words) == 1:
            return {"hosts": radio.bonds.hosts(), "name": radio.name, "connected": radio.trusted}
        if verb == "pair" and len(words) == 1:
            return {"name": radio.name, "passkey": "%06d" % radio.pair(), "seconds": 60}
        if verb == "forget" and len(words) == 2:
            if not radio.forget(words[1].lower()):
                raise ValueError("no bonded host has this address: see 'radio list'")
            self._save()
            return {"hosts": radio.bonds.hosts()}
        raise ValueError("radio takes list, pair, or forget and an address")
