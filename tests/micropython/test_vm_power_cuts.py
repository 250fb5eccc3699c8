"""A power cut during ``save``, on the real file systems: all strips keep all they had, or get all.

The cuts are in each operation of the flash: a program or an erase that stops half-way.
"""

import pytest

pytestmark = pytest.mark.board

CHANGES = {
    "1": ["settings", "autoexpose", "new_layout", "calibrate"],
    "2": ["everything", "removal"],
}


def test_a_cut_in_any_operation_of_the_flash_leaves_the_old_or_the_new(unix64):
    rows = [line.split() for line in unix64.run("power_cuts")]
    assert [row[:3] for row in rows] == [
        [system, strips, change]
        for system in ("Littlefs", "Fat")
        for strips in CHANGES
        for change in CHANGES[strips]
    ]
    assert all(int(new) for *_, new in rows)
    assert sum(int(old) for *_, old, _ in rows) > 100
