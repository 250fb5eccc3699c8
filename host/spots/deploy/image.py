"""``spots image``: one file with a runtime, the firmware and a layout, for a bare board.

The file contains the whole file system of the board, so the board loses what was stored on it.
"""

import json
import subprocess
from pathlib import Path

from ..common import atomic
from ..common.bounded import read_bytes
from ..common.python import code_command
from ..errors import FileError, SettingError
from .build import build
from .runtime_files import form_of
from .staging import Device, device_of

RUNTIME_MAX_BYTES = 64 << 20

# Settings of a board that starts as a keyboard.
KEYBOARD_SETTINGS = ("keys=1",)

# The firmware's own code writes what `save` would have stored; it uses the current folder.
_SAVE = """
import json, sys
from spots_device.board.store import Store
Store().save(json.load(sys.stdin))
"""


def image(
    board: str,
    runtime: str | Path,
    out: str | Path,
    strips: int = 1,
    layout: list[str] = (),
    led: str | None = None,
) -> None:
    """Write one file that makes a board with a boot loader into a board with SPOTS.

    `runtime` is MicroPython for the board, as downloaded (a ``.uf2``, or a ``.bin`` for an
    ESP32-S3), or CircuitPython's ``.uf2``. With the lines of a `layout`, the board starts as a
    keyboard as soon as it has a calibration. `led` is one of `spots_device.board.light.LEDS`, in
    place of that of ``board.toml``. SettingError or FileError if the runtime is not one for this
    board, or is damaged; if the files do not fit; if the file cannot be written. Nothing is written
    then.
    """
    device = device_of(board, strips)
    form = form_of(device)
    out = Path(out)
    if out.suffix.lower() != form.suffix:
        raise SettingError(f"an image for {board} is a {form.suffix} file: change --out {out}")
    atomic.distinct({"--runtime": Path(runtime), "--out": out})
    kind = atomic.begins(f"a {form.suffix} file", *form.heads)
    atomic.check_writable(out, kind)
    data = compose(device, Path(runtime), strips, layout, led)
    with atomic.replacing(out, kind) as file:
        file.write(data)


def compose(
    device: Device, runtime: Path, strips: int, layout: list[str], led: str | None
) -> bytes:
    """Return the content of an image, see `image`."""
    form = form_of(device)
    try:
        data = read_bytes(runtime, RUNTIME_MAX_BYTES)
    except OSError as error:
        raise FileError(
            f"cannot read {runtime} ({error.strerror}): name {form.source} with --runtime", runtime
        ) from None
    if not data.startswith(form.heads):
        raise FileError(
            f"{runtime} is not {form.source}: download it, and name it with --runtime", runtime
        )
    with atomic.temporary() as folder:

        def built() -> Path:
            files = build(device.name, folder, strips)
            if stored := _stored(strips, layout, led):
                _save(files, stored)
            return files

        return form.compose(device, data, str(runtime), built)


def _stored(strips: int, layout: list[str], led: str | None) -> list[tuple[str, list[str]]]:
    """Return name and lines of each part that the first start finds stored on the board."""
    stored = []
    for strip in range(strips):
        # As in the names of the board's files, see `flash.USER_FILES`.
        name = f"settings{strip or ''}"
        lines = [f"led={led}"] if led else []
        if layout and strip == 0:
            lines += KEYBOARD_SETTINGS
            stored.append(("layout", layout))
        if lines:
            stored.append((name, lines))
    return stored


def _save(folder: Path, parts: list[tuple[str, list[str]]]) -> None:
    subprocess.run(code_command(_SAVE), cwd=folder, input=json.dumps(parts), text=True, check=True)
