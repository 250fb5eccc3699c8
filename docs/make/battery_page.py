"""Writes into docs/play/radio.md how long a battery lasts: computed from published currents."""

from __future__ import annotations

import re
from pathlib import Path

_PAGE = Path(__file__).parents[2] / "docs/play/radio.md"
_HEAD = "| LED | current | with 250 mAh | with 500 mAh |\n|---|---|---|---|\n"
# Seeed, "Power Consumption" of the XIAO ESP32S3: 25 mA in modem sleep, without radio. Of the XIAO
# ESP32C3 it also tells modem sleep with Bluetooth LE, 26.8 mA, and without radio, 24.4 mA.
_BOARD_MA = 25 + 26.8 - 24.4
_CHIP_MA = (
    0.3  # AS7341, datasheet DS000504, "Electrical characteristics": at most, while it measures
)
_LEDS_MA = 4, 10, 20  # on all the time
_USABLE = 0.8  # part of the capacity: assumed


def document(page: Path = _PAGE) -> str:
    """Return the text of the page."""
    rows = "".join(_row(led_mA) for led_mA in _LEDS_MA)
    text = page.read_text(encoding="utf-8")
    assert _HEAD in text
    return re.sub(rf"{re.escape(_HEAD)}(?:\|.*\n)*", _HEAD + rows, text)


def _row(led_mA: int) -> str:
    # The regulator of the board is linear: the battery gives the current that the board takes.
    total_mA = _BOARD_MA + _CHIP_MA + led_mA
    hours = (f"{_USABLE * capacity_mAh / total_mA:.0f} h" for capacity_mAh in (250, 500))
    return f"| {led_mA} mA | {total_mA:.0f} mA | {' | '.join(hours)} |\n"


def main() -> None:
    """Write the page."""
    _PAGE.write_text(document(), encoding="utf-8")


if __name__ == "__main__":
    main()
