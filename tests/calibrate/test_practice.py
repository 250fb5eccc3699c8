"""Practice of a session: real questions, a simulated finger, and a score from the simulator."""

import io
import re

import pytest

from spots.calibrate.session.guide import ruler_lines
from spots.cli import main

ANSWER = {"rough": r"score: position (\S+) mm rms, \S+ mm at most; your .* by (\S+) mm rms from ru"}
ANSWER["fine"] = (
    r"score: position (\S+) mm rms, \S+ mm at most, force (\S+) N rms; "
    r"your answers differ by (\S+) mm and (\S+) N rms from ruler and scale"
)


def read_ruler(lines):
    """Return the position in mm that a picture of a ruler shows."""
    numbers, line, mark = lines
    per_mm = line.index("|", 7) - 6
    return float(numbers.split()[1]) + (mark.index("▲") - 6) / per_mm


class Reader(io.StringIO):
    """A person at a terminal who reads the simulated ruler and scale, or only presses Enter."""

    def __init__(self, reads=True, slips=False):
        super().__init__()
        self._reads, self._slips, self.asked = reads, slips, 0

    def readline(self):
        self.asked += 1
        if self._slips and self.asked in (5, 6):  # types a wrong position, and takes it back
            return "77 mm\n" if self.asked == 5 else "undo\n"
        lines = self.getvalue().splitlines()
        answer = []
        if lines[-1].startswith("what do") and "second" not in lines[-1]:
            at = max(i for i, line in enumerate(lines) if line.startswith("ruler "))
            answer.append(f"{read_ruler(lines[at - 1 : at + 2]):.1f}mm")
        if "scale" in lines[-1]:
            answer.append(re.findall(r"scale: (\d+ g)", self.getvalue())[-1])
        return " ".join(answer if self._reads else []) + "\n"


def practised(monkeypatch, tmp_path, person, *words):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")  # so that no question is wrapped
    monkeypatch.setattr("sys.stdin", person)
    monkeypatch.setattr("sys.stdout", person)
    assert main(["calibrate", "--practice", *words]) == 0
    assert list(tmp_path.iterdir()) == []
    kind = "rough" if "--rough" in words else "fine"
    found = re.search(ANSWER[kind], person.getvalue())
    return [float(value) for value in found.groups()]


@pytest.mark.parametrize("place_um", [0.0, 2300.0, 42_500.0, 85_000.0])
def test_a_ruler_shows_a_position(place_um):
    assert read_ruler(ruler_lines(place_um)) == pytest.approx(place_um / 1000, abs=0.09)


@pytest.mark.board
def test_a_careful_person_gets_a_good_score_and_no_file(monkeypatch, tmp_path):
    person = Reader()
    position, force, read_mm, read_N = practised(monkeypatch, tmp_path, person, "--places", "20")
    assert person.asked >= 20
    assert read_mm < 0.1
    assert read_N < 0.01
    assert position < 0.2
    assert force < 0.1


@pytest.mark.board
def test_a_person_who_only_presses_enter_gets_the_score_for_it(monkeypatch, tmp_path):
    careful = practised(monkeypatch, tmp_path, Reader(slips=True), "--rough", "--places", "9")
    careless = practised(monkeypatch, tmp_path, Reader(False), "--rough", "--places", "9")
    assert careful[1] < 0.1
    assert careless[1] > 0.5
    assert careful[0] < careless[0] / 2


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ("joint", "--practice has no 'joint'"),
        ("--port /dev/x", "leave out --port, --session and --out"),
        ("--session a.jsonl", "leave out --port, --session and --out"),
        ("--out a.toml", "leave out --port, --session and --out"),
        ("--length-mm 60", "the simulated strip is 85 mm long, not 60 mm"),
        ("--sensor nosuch", "cannot read the sensor file nosuch"),
    ],
)
def test_what_practice_cannot_do_is_one_sentence(line, says, capsys):
    assert main(["calibrate", "--practice", *line.split()]) == 2
    errors = capsys.readouterr().err
    assert says in errors
    assert errors.count("\n") == 1
