"""Bonds: what the Bluetooth stack must remember of the computers and phones that may connect.

MicroPython's stack asks for these *secrets* and hands them over in its event handler. A secret has
a kind, a key that begins with the kind of the host's address and the address, and a value.
"""

from array import array
from binascii import hexlify, unhexlify

from .. import const

OURS = const(1)  # kinds of secrets: our key of a bond, the host's key, and a subscription
HOSTS_MAX = const(3)  # CONFIG_BT_NIMBLE_MAX_BONDS of MicroPython's images
_SUBSCRIPTIONS = const(3)  # kind; and those above have no address
_SLOTS = const(20)  # two secrets and some subscriptions of each host, and our own keys
_SIZE = const(128)  # of key and value
_ADDRESS = const(7)  # bytes of an address in a key, with its kind

_FREE = const(0)
_KEPT = const(1)
_FRESH = const(2)  # of the present connection, and not kept yet
_HIDDEN = const(3)  # the stack has deleted it in the present connection


class Bonds:
    """Secrets in slots of a fixed size. `get`, `put` and `drop` allocate a view at most.

    Parameters
    ----------
    lines : list of str
        Result of `lines` of an earlier start.

    Attributes
    ----------
    served : bool
        Whether the stack got the key of a kept bond since `begin`.
    paired : bool
        Whether the stack has changed secrets of a bond since `begin`.
    """

    def __init__(self, lines):
        self._slots = [bytearray(_SIZE) for _ in range(_SLOTS)]
        self._views = [memoryview(slot) for slot in self._slots]
        # For each slot: state, kind, size of the key, size of the value.
        self._heads = array("h", bytes(2 * 4 * _SLOTS))
        self.served = self.paired = False
        for line in lines:
            kind, key, value = line.split()
            self.put(int(kind), unhexlify(key), unhexlify(value))
        self.keep()

    def begin(self):
        """Forget what the last connection did."""
        self.served = self.paired = False

    def get(self, kind, index, key):
        """Return the value of a secret, or of the `index`-th one of a kind if `key` is None."""
        for i in range(_SLOTS):
            if self._is(i, kind, key):
                if index and key is None:
                    index -= 1
                    continue
                if kind == OURS and key is not None:
                    self.served = True
                at = 4 * i
                size = self._heads[at + 2]
                return self._views[i][size : size + self._heads[at + 3]]
        return None

    def put(self, kind, key, value):
        """Store a secret as fresh; return whether there was room."""
        self.paired = self.paired or kind < _SUBSCRIPTIONS
        if len(key) + len(value) > _SIZE:
            return False
        free = -1
        for i in range(_SLOTS):
            if self._is(i, kind, key):
                self._retire(i, kind)
            if free < 0 and not self._heads[4 * i]:
                free = i
        if free < 0:
            return False
        slot = self._slots[free]
        for i in range(len(key)):
            slot[i] = key[i]
        for i in range(len(value)):
            slot[len(key) + i] = value[i]
        at = 4 * free
        self._heads[at + 1] = kind
        self._heads[at + 2] = len(key)
        self._heads[at + 3] = len(value)
        self._heads[at] = _FRESH
        return True

    def drop(self, kind, key):
        """Hide a secret that the stack deletes, until `keep` or `restore`; return whether it is.

        The stack deletes a bond when somebody with the host's address pairs again, and asks until
        it is gone. So a refusal would stop the stack, and a deletion would let anybody end a bond.
        """
        for i in range(_SLOTS):
            if self._is(i, kind, key):
                self.paired = self.paired or kind < _SUBSCRIPTIONS
                self._retire(i, kind)
                return True
        return False

    def _retire(self, i, kind):
        # Only a kept key of a bond can come back.
        is_hidden = kind < _SUBSCRIPTIONS and self._heads[4 * i] == _KEPT
        self._heads[4 * i] = _HIDDEN if is_hidden else _FREE

    def keep(self):
        """Keep the fresh secrets, and forget the hidden ones."""
        self._settle(_KEPT, _FREE)

    def restore(self):
        """Forget the fresh secrets, and show the hidden ones again."""
        self._settle(_FREE, _KEPT)

    def _settle(self, fresh, hidden):
        for i in range(0, 4 * _SLOTS, 4):
            if self._heads[i] == _FRESH:
                self._heads[i] = fresh
            elif self._heads[i] == _HIDDEN:
                self._heads[i] = hidden

    def lines(self):
        """Return the kept secrets as lines of text."""
        made = []
        for i in range(_SLOTS):
            state, kind, key, value = self._heads[4 * i : 4 * i + 4]
            if state in (_KEPT, _HIDDEN):
                view = self._views[i]
                made.append(
                    "%d %s %s"
                    % (
                        kind,
                        hexlify(view[:key]).decode(),
                        hexlify(view[key : key + value]).decode(),
                    )
                )
        return made

    def hosts(self):
        """Return the addresses of the bonded hosts, as texts of six bytes with colons."""
        found = []
        for i in range(_SLOTS):
            if self._heads[4 * i] in (_KEPT, _HIDDEN) and self._heads[4 * i + 1] == OURS:
                found.append(self._address(i))
        return found

    def forget(self, address):
        """Delete all secrets of a host; return whether there were some."""
        found = False
        for i in range(_SLOTS):
            if self._heads[4 * i] and self._address(i) == address:
                self._heads[4 * i] = _FREE
                found = True
        return found

    def _address(self, i):
        return ":".join(["%02x" % byte for byte in reversed(bytes(self._views[i][1:_ADDRESS]))])

    def _is(self, i, kind, key):
        at = 4 * i
        heads = self._heads
        if heads[at] not in (_KEPT, _FRESH) or heads[at + 1] != kind:
            return False
        if key is None:
            return True
        if heads[at + 2] != len(key):
            return False
        slot = self._slots[i]
        for j in range(len(key)):  # noqa: SIM110
            if slot[j] != key[j]:
                return False
        return True
