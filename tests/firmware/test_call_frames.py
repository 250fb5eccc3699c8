"""The call frames of the functions that run for every sample fit MicroPython's stack.

MicroPython allocates a larger frame on the heap at each call, and frees it at the return. This
costs 40 us on an RP2040, and more if the heap is fragmented. A frame has a word for each local
variable and each value on the stack, and three for each exception handler.
"""

import re
import subprocess
from pathlib import Path

import pytest

import spots_device
from spots.deploy.build import mpy_cross_command

pytestmark = pytest.mark.board

_PACKAGE = Path(spots_device.__file__).parent
# An .mpy file stores no name that is built into MicroPython, such as `write`.
_PREFIX = "of_"
WORDS_MAX = 11  # VM_MAX_STATE_ON_STACK in MicroPython's py/objfun.c
_BYTECODE = 0  # kind of code in an .mpy file

# Functions that run for every sample of a calibrated and touched strip that streams TOUCH frames,
# and those of the keys.
EACH_SAMPLE = {
    "board/app": "_pass _sample _pump",
    "board/aligned": "next _left_us lead_us early held skip",
    "sensor/as7341": "poll",
    "sensor/fifo": "read",
    "sensor/registers": "read fetch stamp",
    "fingers/pair": "_separate",
    "fingers/tracker": "take",
    "keys/caps": "press shifted",
    "keys/dance": "press released beside tick forget _decide",
    "keys/engine": "press release_one firm move tick run forget is_certain same_key _put "
    "_follow _remove _next _beside _do _let_go _begin _open_at _tap _prepare _decide _is_hold "
    "close _press_firmly _tap_due _act click then _perform _start _is_late "
    "_press_key typed _end _row_at _again_at _is_near _is_on_one",
    "keys/keypad": "tick until down at firm up next second left stuck _wait _press_waiting",
    "keys/layers": "top press hold",
    "keys/merge": "press release mask _hold _wanted _set _switch _report _find",
    "keys/moves": "move _may_swipe _swipe _step _slide _action",
    "keys/morph": "press released",
    "keys/repeat": "press pressed",
    "usb/reports": "key flush put pump expire has_room _append",
    "keys/switch": "free place past",
    "keys/sticky": "press release pressed tick forget holds _finish _change",
    "reading/frame": "send _send_body",
    "reading/kernel": "process _add _stamp estimate _take_logs _locate _beyond _touch_flags "
    "_off _follow_touch _follow_light _odd_light put_touch _put_estimates _put_header add_crc "
    "cobs_encode frame",
    "reading/log2": "log2_q20",
    "reading/lone": "begin move is_doubtful _is_lone _weigh _add_noise learn confirm _agrees "
    "_jump _follow_drift",
    "reading/sticking": "unstick _fade _set_floor _forget _peak _measure _net _correct",
    "sensor/burst": "unpack",
    "sensor/pacing": "early found held skip",
    "runtime/micropython": "write _has_room _put read",
    "reading/strip": "take _sample_flags _use_reading _finish _follow_baseline",
    "reading/ambient": "follow _is_shifted _slope _is_ambient _left _net _move _expect",
    "reading/dark": "is_due chi2",
    "reading/silicone": "take _follow_time _creep _corrected _excess",
    "radio/wireless": "work _follow_presses",
    "radio/presses": "are_made",
    "radio/hosts": "follow read write is_heard _next_by_radio _is_whole",
    "radio/peripheral": "work write flush read",
    "keys/gamepad": "take _x _z",
    "usb/gamepad": "update _send _put",
    "board/interfaces": "pump _offer usage scroll key has_room send _flush",
    "board/outputs": "take pump _track",
}


class Mpy:
    """Reads the call frames of all functions from an .mpy file (version 6)."""

    def __init__(self, data):
        self._data = data
        self._at = 4  # after the header
        names, constants = self._number(), self._number()
        self._names = [self._name() for _ in range(names)]
        for _ in range(constants):
            self._constant()
        self.words = {}  # size of the frame in words, by the function's name
        self._code()

    def _byte(self):
        self._at += 1
        return self._data[self._at - 1]

    def _number(self):
        value, byte = 0, 0x80
        while byte & 0x80:
            byte = self._byte()
            value = value << 7 | byte & 0x7F
        return value

    def _text(self, size):
        self._at += size
        return self._data[self._at - size : self._at].rstrip(b"\0").decode(errors="replace")

    def _name(self):
        size = self._number()
        return "" if size & 1 else self._text((size >> 1) + 1)  # odd: built into MicroPython

    def _constant(self):
        kind = self._byte()
        if kind == 10:  # a tuple
            for _ in range(self._number()):
                self._constant()
        elif kind > 4:
            self._text(self._number() + (kind in (5, 6)))  # str and bytes end with a zero byte

    def _code(self):
        head = self._number()
        end = self._at + (head >> 3)
        if head & 3 == _BYTECODE:
            self._prelude()
        self._at = end
        if head & 3:
            self._number()
        if head & 4:
            for _ in range(self._number()):
                self._code()

    def _prelude(self):
        byte = self._byte()
        values, handlers, n = byte >> 3 & 0xF, byte >> 2 & 1, 0
        while byte & 0x80:
            byte = self._byte()
            values |= (byte & 0x30) << 2 * n
            handlers |= (byte & 0x02) << n
            n += 1
        while self._byte() & 0x80:  # sizes of line numbers and closures
            pass
        name = self._names[self._number()].removeprefix(_PREFIX)
        self.words[name] = max(values + 1 + 3 * handlers, self.words.get(name, 0))


def _words(text, folder):
    source, target = folder / "module.py", folder / "module.mpy"
    source.write_text(re.sub(r"\bdef (?=\w)", f"def {_PREFIX}", text))
    subprocess.run([*mpy_cross_command(), "-O3", "-o", str(target), str(source)], check=True)
    return Mpy(target.read_bytes()).words


@pytest.mark.parametrize("module", EACH_SAMPLE)
def test_no_function_of_a_sample_needs_a_frame_on_the_heap(module, tmp_path):
    words = _words((_PACKAGE / f"{module}.py").read_text(), tmp_path)
    for name in EACH_SAMPLE[module].split():
        assert words[name] <= WORDS_MAX, f"{module}.{name} needs {words[name]} words"


def test_the_words_of_a_frame(tmp_path):
    words = _words(
        "def none(): pass\n"
        "def three(a, b, c): pass\n"
        "def sum_of(a, b, c): return a + b * c\n"
        "def guarded(a):\n try: a()\n except OSError: pass\n",
        tmp_path,
    )
    assert words["sum_of"] == 3 + 3
    assert words["three"] - words["none"] == 3
    assert words["guarded"] >= 1 + 3 + 4  # an exception has up to four values on the stack
