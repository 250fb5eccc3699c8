"""The SMUX map: connects photodiodes to the six ADCs.

Source: ams AN000666, table of pixels. A photodiode consists of one or two pixels. Pixel number p
has one nibble of byte p >> 1: the high nibble if p is odd, else the low nibble. The value of the
nibble is 0 (not connected) or the number of the ADC + 1.
"""

# Name of a diode: its pixels.
PIXELS = {
    "F1": (2, 32),
    "F2": (10, 25),
    "F3": (1, 31),
    "F4": (11, 26),
    "F5": (13, 19),
    "F6": (8, 29),
    "F7": (14, 20),
    "F8": (7, 28),
    "CLEAR": (17, 35),
    "NIR": (38,),
    "DARK": (37,),
}
CHANNELS = 6


def smux_map(plan):
    """Return the 20 bytes of the SMUX map that connects each diode of a plan to one ADC.

    ValueError if the plan is not six different names in `PIXELS`.
    """
    if len(plan) != CHANNELS or len(set(plan)) != CHANNELS:
        raise ValueError("a channel plan needs six different diodes")
    image = bytearray(20)
    for adc in range(CHANNELS):
        if plan[adc] not in PIXELS:
            raise ValueError(
                "no diode is called '%s': use F1 to F8, CLEAR, NIR or DARK" % plan[adc]
            )
        for pixel in PIXELS[plan[adc]]:
            image[pixel >> 1] |= (adc + 1) << (4 * (pixel & 1))
    return bytes(image)
