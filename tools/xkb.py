"""libxkbcommon by ctypes: what a Linux desktop makes of the key codes of a keyboard.

Used to write the host layouts (`host_layouts.py`) and to test them. The functions are those of
libxkbcommon's documentation, https://xkbcommon.org/doc/current/.
"""

import ctypes as c

RULES, MODEL = b"evdev", b"pc105"
CODE_OFFSET = 8  # an XKB key code is that of Linux plus 8
_COMPOSED, _CANCELLED = 2, 3
_POINTERS = (
    "xkb_context_new",
    "xkb_keymap_new_from_names",
    "xkb_state_new",
    "xkb_compose_table_new_from_locale",
    "xkb_compose_state_new",
)


class _Names(c.Structure):
    _fields_ = [(name, c.c_char_p) for name in ("rules", "model", "layout", "variant", "options")]


class Xkb:
    """A keyboard of a Linux desktop with one layout and the dead keys of a locale.

    Parameters
    ----------
    layout : str
        XKB name of the layout, with its variant in parentheses if it has one: ``us(intl)``.
    locale : str
        Locale whose Compose file is used, such as ``de_DE.UTF-8``.

    Raises
    ------
    OSError
        If the library or the data of layout or locale are not installed.
    """

    def __init__(self, layout, locale):
        self._lib = lib = c.CDLL("libxkbcommon.so.0")
        for name in _POINTERS:
            getattr(lib, name).restype = c.c_void_p
        context = self._made(lib.xkb_context_new(0))
        name, _, variant = layout.rstrip(")").partition("(")
        names = _Names(RULES, MODEL, name.encode(), variant.encode(), b"")
        keymap = self._made(lib.xkb_keymap_new_from_names(context, c.byref(names), 0))
        self._state = self._made(lib.xkb_state_new(keymap))
        table = lib.xkb_compose_table_new_from_locale(context, locale.encode(), 0)
        self._compose = self._made(lib.xkb_compose_state_new(self._made(table), 0))

    def _made(self, pointer):
        if not pointer:
            raise OSError(
                "libxkbcommon has no such layout or locale: install xkb-data, libx11-data"
            )
        return c.c_void_p(pointer)

    def key(self, code, pressed):
        """Press or release the key with Linux's code; return the typed text, often empty."""
        text = ""
        if pressed:
            symbol = self._lib.xkb_state_key_get_one_sym(self._state, code + CODE_OFFSET)
            text = self.compose(symbol)
        self._lib.xkb_state_update_key(self._state, code + CODE_OFFSET, int(pressed))
        return text

    def compose(self, symbol):
        """Feed a key symbol; return the typed text: empty in a sequence and for a modifier."""
        lib, state = self._lib, self._compose
        lib.xkb_compose_state_feed(state, symbol)
        status = lib.xkb_compose_state_get_status(state)
        buffer = c.create_string_buffer(64)
        if status == _COMPOSED:
            lib.xkb_compose_state_get_utf8(state, buffer, 64)
            lib.xkb_compose_state_reset(state)
        elif status == _CANCELLED:
            lib.xkb_compose_state_reset(state)
            return "(cancelled)"
        elif not status:
            lib.xkb_keysym_to_utf8(symbol, buffer, 64)
        return buffer.value.decode()

    def symbol(self, code, modifiers=()):
        """Return name and character (or an empty text) of a key, with modifier keys down."""
        lib = self._lib
        for each in modifiers:
            lib.xkb_state_update_key(self._state, each + CODE_OFFSET, 1)
        number = lib.xkb_state_key_get_one_sym(self._state, code + CODE_OFFSET)
        for each in reversed(modifiers):
            lib.xkb_state_update_key(self._state, each + CODE_OFFSET, 0)
        name = c.create_string_buffer(64)
        lib.xkb_keysym_get_name(number, name, 64)
        return name.value.decode(), self._character(number)

    def named(self, name):
        """Return the number and the character (or an empty text) of a key symbol."""
        number = self._lib.xkb_keysym_from_name(name.encode(), 0)
        return number, self._character(number)

    def _character(self, number):
        code = self._lib.xkb_keysym_to_utf32(number)
        return chr(code) if code else ""
