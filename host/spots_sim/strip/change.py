"""Changes of a strip since its calibration: ageing, temperature, and a warm LED."""

from __future__ import annotations

from typing import Annotated, get_type_hints

import msgspec


def _within(low: float, high: float):
    return Annotated[float, msgspec.Meta(ge=low, le=high)]


_Struct = {"frozen": True, "forbid_unknown_fields": True, "kw_only": True}
_Shift = _within(-50, 50)
_Relative = _within(-99, 1000)


class Change(msgspec.Struct, **_Struct):
    """Changes of a sensor since its calibration, relative to the values of the sensor file.

    Attributes
    ----------
    die_nm, phosphor_nm : float
        Shifts of the blue peak and of the phosphor peak in the LED's spectrum, in nm.
    phosphor_fwhm_nm : float
        Change of the full width at half maximum of the phosphor peak, in nm.
    bands_nm : float
        Shift of all filters of the sensor, in nm.
    blue_share_percent : float
        Change of the blue peak's share in the LED's power, in percentage points.
    light_percent, dye_percent, clear_percent : float
        Relative changes of the coupled light, of the dye's strength, and of the loss in the clear
        material, in per cent.
    dye_near_percent, dye_middle_percent, dye_far_percent : float
        Relative changes of the dye's strength in the third of the strip at the sensor, in the
        middle third, and in the far third.
    far_end_percent : float
        Change of the share of the light that the far end of the dyed guide reflects, in percentage
        points.
    tilt_percent : float
        Change of the light at 680 nm relative to the light at 415 nm, in per cent. Between these
        wavelengths the change is linear.
    temperature_K : float
        Warming of strip, LED and sensor, in K; `Temperature` converts it to the other changes. The
        thermometer of a virtual board measures it, too: 0 K is 25 degrees Celsius.
    """

    die_nm: _Shift = 0.0
    phosphor_nm: _Shift = 0.0
    phosphor_fwhm_nm: _Shift = 0.0
    bands_nm: _Shift = 0.0
    blue_share_percent: _Shift = 0.0
    light_percent: _Relative = 0.0
    dye_percent: _Relative = 0.0
    clear_percent: _Relative = 0.0
    dye_near_percent: _Relative = 0.0
    dye_middle_percent: _Relative = 0.0
    dye_far_percent: _Relative = 0.0
    far_end_percent: _Shift = 0.0
    tilt_percent: _Shift = 0.0
    temperature_K: _within(-100, 100) = 0.0

    def __add__(self, other: Change) -> Change:
        if other is NONE:  # the case for most samples
            return self
        return Change(**{name: getattr(self, name) + getattr(other, name) for name in NAMES})


NAMES = Change.__struct_fields__
NONE = Change()

# The keys of `Change`, each as a list of points (time in s, value), joined by straight lines.
ChangeInTime = msgspec.defstruct(
    "ChangeInTime",
    [
        (name, list[tuple[_within(0, 1e12), kind]], msgspec.field(default_factory=list))
        for name, kind in get_type_hints(Change, include_extras=True).items()
    ],
    **_Struct,
)


class Temperature(msgspec.Struct, **_Struct):
    """Temperature coefficients of a sensor, and the self-heating of its LED.

    Each coefficient ``NAME_per_K`` is the change per kelvin of the attribute ``NAME`` of `Change`.
    Only `length_ppm_per_K` has no such attribute: it is the thermal expansion of the strip. A lit
    LED heats itself: its temperature rises by `led_K_per_mA` for each mA, with the time constant
    `led_warm_up_s` in seconds. This rise changes only the attributes of LED, phosphor and light.
    """

    # Blue InGaN dies: 0.03 to 0.05 nm/K, typical of LED datasheets.
    die_nm_per_K: float = 0.04
    # Assumed: YAG:Ce shifts to the red and broadens a little, and loses more light than the die.
    phosphor_nm_per_K: float = 0.015
    phosphor_fwhm_nm_per_K: float = 0.05
    blue_share_percent_per_K: float = -0.011
    # White LEDs: -0.2 to -0.4 %/K, typical of LED datasheets.
    light_percent_per_K: float = -0.3
    # Assumed: interference filters on silicon, 0.3 nm in 10 K.
    bands_nm_per_K: float = 0.03
    # Assumed: no effect is known except that of `length_ppm_per_K`.
    dye_percent_per_K: float = 0.0
    clear_percent_per_K: float = 0.0
    tilt_percent_per_K: float = 0.0
    # Cast polyurethane: 100 to 200 ppm/K, typical. The volume grows too, and dilutes the dye.
    length_ppm_per_K: float = 150.0
    # 0 is an ideal LED, which stays cool. An LED with 3 V and a thermal
    # resistance of 200 K/W has 0.6.
    led_K_per_mA: Annotated[float, msgspec.Meta(ge=0, le=100)] = 0.0
    led_warm_up_s: Annotated[float, msgspec.Meta(gt=0, le=1e6)] = 60.0

    def resolved(self, change: Change, led_K: float = 0.0) -> Change:
        """Return `change` plus the effects of its temperature, and of the LED's self-heating.

        `led_K` is the temperature rise of the LED by its own power. The sum keeps the
        `temperature_K` of `change`.
        """
        return change + Change(
            **{
                name: getattr(self, f"{name}_per_K")
                * (change.temperature_K + (led_K if name in _OF_LED else 0.0))
                for name in _BY_TEMPERATURE
            }
        )

    def volume(self, change: Change) -> float:
        """Return the volume of the warm strip divided by its volume at the calibration."""
        return (1 + 1e-6 * self.length_ppm_per_K * change.temperature_K) ** 3


_BY_TEMPERATURE = [name for name in NAMES if f"{name}_per_K" in Temperature.__struct_fields__]
_OF_LED = ("die_nm", "phosphor_nm", "phosphor_fwhm_nm", "blue_share_percent", "light_percent")
