"""Settings of an LED that the sensor does not drive. Imported only if such a setting is used."""

from ..reading.decode import DARK_SAMPLES
from ..sensor.exposure import DEFAULT_LED_MA, GAIN_MAX, MAX_US
from ..sensor.smux import CHANNELS

# Values of the setting ``led``. The strip's LED is switched by the sensor's LED driver (ldr), by a
# pin of the board (gpio), or not at all (always).
LEDS = ("ldr", "gpio", "always")
NO_DARK = "this LED is always on, and no dark frame is stored for these settings: run spots dark"
_DARK_MAX = (GAIN_MAX, MAX_US) + CHANNELS * (65_535 * DARK_SAMPLES,)


def settle(changes, values, board):
    """Validate new values of ``led`` and ``dark``, and adapt settings that depend on others.

    A new ``led`` changes ``led_mA``. A new ``led`` or ``channels`` removes the stored dark frame.

    Parameters
    ----------
    changes : dict
        New values of settings by name; changed in place. ``led`` and ``dark`` are str; all other
        values are validated already.
    values : dict
        Present settings, see `settings.BoardSettings`.
    board : object
        Module board_config.

    Raises
    ------
    ValueError
        If ``led`` or ``dark`` is invalid, or the board has no pin for ``led=gpio``.
    """
    led = changes.get("led", values["led"])
    if led not in LEDS:
        raise ValueError("led must be one of " + ", ".join(LEDS))
    if led == "gpio" and not hasattr(board, "STRIP_LED_PIN"):
        raise ValueError("led=gpio needs a STRIP_LED_PIN in board.toml")
    is_new = led != values["led"]
    if led != "ldr":
        # The breakout's own LED, if it has one, stays off.
        if is_new or "led_mA" in changes:
            changes["led_mA"] = 0
    elif is_new and "led_mA" not in changes:
        changes["led_mA"] = DEFAULT_LED_MA
    if "dark" in changes:
        changes["dark"] = _dark(changes["dark"])
    elif is_new or changes.get("channels", values["channels"]) != values["channels"]:
        changes["dark"] = []


def _dark(text):
    try:
        dark = list(map(int, text.split(","))) if text else []
        for i in range(len(dark)):
            if not 0 <= dark[i] <= _DARK_MAX[i]:
                raise ValueError
        if len(dark) in (0, len(_DARK_MAX)):
            return dark
    except (ValueError, IndexError):
        pass
    raise ValueError("dark must be a gain, an exposure and six sums, as 'spots dark' stores them")
