"""Limits of the memory that the firmware needs on a board: built files, and estimated heap."""

from __future__ import annotations

import pytest

from spots.deploy.build import files_of
from spots.deploy.staging import board_names, device_of

pytestmark = pytest.mark.board

# A Pico has about 240 KB of heap.
HEAP_MAX_BYTES = 91 * 1024
TYPING_MAX_BYTES = 133 * 1024
FLASH_MAX_BYTES = 104 * 1024
# Machine code for this processor is larger. Its board has 8 MB of flash.
XTENSA_MAX_BYTES = 102 * 1024
RADIO_MAX_BYTES = 11 * 1024
BOARDS = [name for name in board_names() if device_of(name).runtime == "micropython"]


def test_every_board_with_mpy_files_is_there(results):
    assert sorted(results["boards"]) == sorted(BOARDS)


@pytest.mark.parametrize("board", BOARDS)
def test_flash_is_that_of_the_built_modules(results, board, built):
    files = files_of(built(board))
    size = sum(len(data) for path, data in files.items() if path.endswith(".mpy"))
    most = XTENSA_MAX_BYTES if device_of(board).march == "xtensawin" else FLASH_MAX_BYTES
    most += RADIO_MAX_BYTES if "BLUETOOTH" in device_of(board).device else 0
    assert results["boards"][board]["mpy_bytes"] == size <= most


@pytest.mark.parametrize("board", BOARDS)
def test_the_running_application_leaves_most_of_a_small_board_free(results, board):
    spent = results["boards"][board]
    # Modules of keys and contacts are in the flash, but not loaded.
    assert spent["loaded_bytes"] < spent["mpy_bytes"]
    assert spent["loaded_bytes"] < spent["started_bytes"] <= HEAP_MAX_BYTES
    assert spent["started_bytes"] < spent["calibrated_bytes"]
    assert spent["calibrated_bytes"] < spent["typing_bytes"] <= TYPING_MAX_BYTES
