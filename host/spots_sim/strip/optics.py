"""Optics of a simulated strip: from the LED to the photodiodes, at each wavelength.

A count is an integral over wavelength. Its integrand is the product of four factors: LED spectrum,
coupling, decay in the dyed guide (Eq. 1 of the paper) and channel response. A channel is a band of
wavelengths, so the logarithm of its count is not exactly linear in the position. The same is true
of the real sensor.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from msgspec import structs

from . import spectrum
from .change import NONE, Change
from .contact import coupling
from .files import Dye, Led, SensorFile
from .path import DyedPath

WAVELENGTH_NM = np.arange(380.0, 1000.0, 4.0)

# DS000504, table of optical characteristics: centre and FWHM in nm, and counts under a warm-white
# 2700 K LED of 107.67 uW/cm2 at 64x in 27.8 ms. CLEAR has no FWHM there; the
# broad response of silicon is used. NIR is omitted, because the lamp's emission there is unknown.
_CHANNELS = {
    "F1": (415, 26, 55), "F2": (445, 30, 110), "F3": (480, 36, 210), "F4": (515, 39, 390),
    "F5": (555, 39, 590), "F6": (590, 40, 840), "F7": (630, 50, 1350), "F8": (680, 52, 1070),
    "CLEAR": (700, 400, 1750),
}  # fmt: skip
_REFERENCE_UW_CM2 = 107.67
_REFERENCE_MS = 27.8
_REFERENCE_GAIN = 64


def _bell(centre_nm: float, fwhm_nm: float) -> np.ndarray:
    return np.exp(-4 * np.log(2) * ((WAVELENGTH_NM - centre_nm) / fwhm_nm) ** 2)


def _normalised(spectrum: np.ndarray) -> np.ndarray:
    return spectrum / spectrum.sum()


def led_spectrum(led: Led) -> np.ndarray:
    """Return the share of the LED's power in each bin of `WAVELENGTH_NM`.

    A measured spectrum is 0 outside of its table.
    """
    if led.spectrum:
        return _normalised(_measured(led.spectrum))
    return _peaks(led)


def _measured(table) -> np.ndarray:
    nm = WAVELENGTH_NM
    (first_nm, _), (last_nm, _) = table[0], table[-1]
    return np.where((nm >= first_nm) & (nm <= last_nm), spectrum.at(table, nm), 0.0)


def _peaks(led: Led) -> np.ndarray:
    blue = _normalised(_bell(led.blue_nm, led.blue_fwhm_nm))
    phosphor = _normalised(_bell(led.phosphor_nm, led.phosphor_fwhm_nm))
    return led.blue_share * blue + (1 - led.blue_share) * phosphor


def decay_per_mm(dye: Dye) -> np.ndarray:
    """Return the decay coefficient k (paper, Eq. 1) per mm in each bin of `WAVELENGTH_NM`."""
    if dye.spectrum:
        edge = spectrum.at(dye.spectrum, WAVELENGTH_NM)
        edge = edge / max(value for _, value in dye.spectrum)
    else:
        edge = 1 / (1 + np.exp((WAVELENGTH_NM - dye.edge_nm) / dye.edge_width_nm))
    return dye.clear_per_mm + dye.strength_per_mm * edge


@lru_cache
def _sensitivity(bands_nm: float = 0.0) -> np.ndarray:
    # Counts at gain 1x per ms and uW/cm2, by channel and wavelength. With `bands_nm` 0, the
    # datasheet's lamp gives the datasheet's counts.
    lamp = 0.06 * _normalised(_bell(450, 26)) + 0.94 * _normalised(_bell(615, 140))
    lamp *= _REFERENCE_UW_CM2 * _REFERENCE_MS * _REFERENCE_GAIN
    bands = np.array([_bell(centre, fwhm) for centre, fwhm, _ in _CHANNELS.values()])
    counts = np.array([count for _, _, count in _CHANNELS.values()])
    shifted = np.array([_bell(centre + bands_nm, fwhm) for centre, fwhm, _ in _CHANNELS.values()])
    return shifted * (counts / (bands @ lamp))[:, None]


def _scale(percent):
    return 1 + percent / 100


def _spectrum_now(led: Led, now: Change) -> np.ndarray:
    if not led.spectrum:
        return _peaks(_led_now(led, now))
    # A measured spectrum changes as the two peaks do.
    before, after = _peaks(led), _peaks(_led_now(led, now))
    factor = np.divide(after, before, out=np.ones_like(before), where=before > 0)
    return _normalised(led_spectrum(led) * factor)


def _led_now(led: Led, now: Change) -> Led:
    return structs.replace(
        led,
        blue_nm=led.blue_nm + now.die_nm,
        phosphor_nm=led.phosphor_nm + now.phosphor_nm,
        phosphor_fwhm_nm=max(led.phosphor_fwhm_nm + now.phosphor_fwhm_nm, 1.0),
        blue_share=min(max(led.blue_share + now.blue_share_percent / 100, 0.0), 1.0),
    )


_BLUEST_NM, _REDDEST_NM = 415.0, 680.0
# Reflectance of skin relative to that of red light, with the rise of haemoglobin at 590 nm. Shape
# after Cooksey, Allen and Tsai, J. Res. NIST 122, 26 (2017), doi 10.6028/jres.122.026.
_SKIN = 0.4 + 0.6 / (1 + np.exp((595.0 - WAVELENGTH_NM) / 12.0))
_GAP_NM = 565.0  # assumed: `gap_percent` does not change the light at this wavelength
_MODE_MN = 6000.0  # assumed: `mode_percent` does not change the path at this force
_KEPT = 256  # number of presses whose light is cached


class Optics:
    """Computes the count rates of a strip's photodiodes.

    All rates are in counts per ms at gain 1x, in the order of the photodiodes in `names`, such as
    ``F1``. `sensor` is the strip as calibrated: its own `change` is not applied. `led_K` is the
    temperature rise of the LED by its own current. `coloured` is whether the colour of a press
    depends on its contact share.
    """

    names = tuple(_CHANNELS)

    def __init__(self, sensor: SensorFile, change: Change = NONE, led_K: float = 0.0):
        now = sensor.temperature.resolved(change, led_K)
        self._led = sensor.led
        self._stretch = sensor.stretch
        dyed = (decay_per_mm(sensor.dye) - sensor.dye.clear_per_mm) * _scale(now.dye_percent)
        self._dyed = dyed / sensor.temperature.volume(change)
        self._clear = sensor.dye.clear_per_mm * _scale(now.clear_percent)
        sensitivity = _sensitivity(now.bands_nm)
        tilted = (WAVELENGTH_NM - _BLUEST_NM) / (_REDDEST_NM - _BLUEST_NM)
        source = _spectrum_now(sensor.led, now) * _scale(now.tilt_percent * tilted)
        self._lit = sensitivity * source
        self._flat = sensitivity.mean(axis=1)
        self._light = _scale(now.light_percent)
        contact = sensor.contact
        self.coloured = bool(contact.gap_percent or contact.mode_percent)
        self._gap = contact.gap_percent / 100 * (WAVELENGTH_NM - _GAP_NM) / _GAP_NM
        self._mode = contact.mode_percent / 100
        self._mode_share = coupling(contact, _MODE_MN)
        self._skin = 1 + contact.skin_percent / 100 * _SKIN if contact.skin_percent else None
        self._path = DyedPath(sensor, now)
        self._length_mm = sensor.length_mm
        self._far_end = (sensor.dye.far_end_percent + now.far_end_percent) / 100
        # Successive presses often have the same arguments, or at least the same width.
        self.press = lru_cache(_KEPT)(self._press)
        self._spread = lru_cache(_KEPT)(self._spread)

    def _press(
        self,
        position_mm: float,
        width_mm: float,
        strain: float = 0.0,
        bend_deg: float = 0.0,
        tilt_percent: float = 0.0,
        share: float = 1.0,
        skin: bool = False,
    ) -> np.ndarray:
        """Return each diode's count rate for a full contact and an LED irradiance of 1 uW/cm2.

        The rates of a smaller contact are `share` times this result. Stretching increases the
        volume and so dilutes the dye (paper, section III.C). Bending reduces the light by the same
        share at every wavelength and position. The tilt is the pressure at the far end of the
        contact minus the mean pressure. Pass `share` only if `coloured` is true, because each value
        takes a place in the cache.
        """
        steepness = self._steepness(share)
        kept = 1 - self._stretch.bend_loss_percent / 100 * bend_deg / 180
        if self._path.is_even and not self._far_end:
            decay, spread = self._spread(width_mm, strain, tilt_percent, steepness)
            guided = np.exp(-decay * position_mm) * spread
        else:
            guided, slope = self._uneven(position_mm, strain, bend_deg, steepness)
            guided *= self._spread(width_mm, strain, tilt_percent, steepness * slope)[1]
        if self.coloured:
            guided *= 1 + (1 - share) * self._gap
        if skin and self._skin is not None:
            guided *= self._skin
        return kept * (self._lit @ guided)

    def narrow(
        self, places_mm: np.ndarray, strain: float = 0.0, bend_deg: float = 0.0
    ) -> np.ndarray:
        """Return what `press` returns for n contacts without width, with a small share: (n, d)."""
        steepness = self._steepness(0.0)
        kept = 1 - self._stretch.bend_loss_percent / 100 * bend_deg / 180
        guided, _ = self._uneven(places_mm[:, None], strain, bend_deg, steepness)
        if self.coloured:
            guided *= 1 + self._gap
        return kept * (guided @ self._lit.T)

    def _uneven(self, position_mm, strain, bend_deg, steepness):
        # The share of the light that arrives, and the derivative of the path by the position. The
        # dye moves with the stretched material.
        path_mm, slope = self._path.at(position_mm / (1 + strain), bend_deg)
        decay, _ = self._spread(0.0, strain, 0.0, steepness)
        dyed = decay - self._clear
        path_mm = path_mm * (1 + strain)
        guided = np.exp(-self._clear * position_mm - dyed * path_mm)
        if self._far_end:
            # Light that starts towards the far end returns by the whole guide.
            end_mm = self._length_mm * (1 + strain)
            end_path_mm = (1 + strain) * self._path.at(self._length_mm, bend_deg)[0]
            guided += self._far_end * np.exp(
                -self._clear * (2 * end_mm - position_mm) - dyed * (2 * end_path_mm - path_mm)
            )
        return guided, slope

    def _steepness(self, share: float) -> float:
        # The path in the dyed guide, divided by the distance along the strip.
        return 1 + self._mode * (share - self._mode_share) if self._mode else 1.0

    def _spread(
        self, width_mm: float, strain: float, tilt_percent: float, steepness: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the decay k per mm and the mean of exp(-k x) over a contact, for each wavelength.

        The contact is `width_mm` wide and centred at x = 0. `steepness` is that of the modes, see
        `_steepness`; the other arguments are those of `_press`.
        """
        volume = (1 + strain) ** (1 - 2 * self._stretch.poisson_ratio)
        decay = self._clear + self._dyed / (volume / steepness)
        half = decay * width_mm / 2
        # sinh(h)/h without 0/0, and its derivative.
        spread = 1 + half**2 / 6 + half**4 / 120
        return decay, spread - tilt_percent / 100 * (half / 3 + half**3 / 30)

    def source_uW_cm2(self, led_mA: float) -> float:
        """Return the LED's irradiance on the chip in uW/cm2 for a full contact at position 0."""
        light_mA = led_mA / (1 + led_mA / self._led.bend_mA)
        return self._light * self._led.irradiance_uW_cm2_per_mA * light_mA

    def ambient(self, irradiance_uW_cm2: float) -> np.ndarray:
        """Return each diode's count rate under ambient light, assuming a flat spectrum."""
        return self._flat * irradiance_uW_cm2
