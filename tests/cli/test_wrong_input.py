"""Wrong input of a new user: one sentence with the next step, and exit code 2."""

import pytest

from spots.cli import main

DESIGN = "design --resolution-um 20 --length-mm"
WRONG = {
    "monitor --port vritual": "there is no port vritual: did you mean virtual?",
    "monitor --port recordng:x": "there is no port recordng:x: did you mean recording:FILE?",
    "monitor --port /dev/nope": "there is no port /dev/nope: 'spots ports' lists the ports",
    "monitor --port /": "/ is a folder, not a serial port: 'spots ports' lists the ports",
    "monitor --port recording:": "the port 'recording:' has no file: write recording:FILE.spots",
    "monitor --port recording:x": "there is no file x: name a file that 'spots record' has made",
    "info /": "/ is a folder, not a recording: name a file",
    "record /nope/run.spots --port virtual": "there is no folder /nope: make it first",
    "monitor --seed x": "whole number from 0 to 9,223,372,036,854,775,808, not 'x'",
    f"{DESIGN} 12cm --rate-hz 10": "argument --length-mm: '12cm' is not a number",
    f"{DESIGN} 120 --rate-hz 1e9": "--rate-hz must be from 0.016 to 1000 Hz, not 1e+09",
    "characterize --mark-error-um nan": "argument --mark-error-um: 'nan' is not a finite number",
    "characterize --mark-error-um=-inf": "argument --mark-error-um: '-inf' is not a finite number",
    f"{DESIGN} inf --rate-hz 10": "argument --length-mm: 'inf' is not a finite number",
    f"{DESIGN} 85 --rate-hz 10 --out {__file__}": "is a file: name a folder",
    "characterize --average x": "argument --average: 'x' is not a whole number",
    "calibrate positon": "argument KIND: there is no 'positon': did you mean position?",
    "keys shwo mini": "argument ACTION: there is no 'shwo': did you mean show?",
    "twin --linkage nope.toml --measure p.csv": "cannot read the linkage file nope.toml, because",
    "twin --linkage nope.toml --record a.spots": "cannot read the linkage file nope.toml, because",
    "flash pico --runtime nope.uf2": "cannot read nope.uf2 (No such file or directory): name Micro",
}


@pytest.mark.parametrize("line", WRONG)
def test_wrong_input_is_one_sentence_with_a_next_step(line, capsys):
    try:
        code = main(line.split())
    except SystemExit as end:
        code = end.code
    errors = capsys.readouterr().err
    assert code == 2
    assert WRONG[line] in errors
    assert errors.count("\n") == 1


@pytest.mark.parametrize("words", [["info", ""], ["subscribe", ""], ["record", "x", "--port", ""]])
def test_an_empty_argument_is_refused(words, capsys):
    with pytest.raises(SystemExit) as end:
        main(words)
    assert end.value.code == 2
    assert "an argument is empty: give it a value, or leave it out" in capsys.readouterr().err


def test_the_doctor_offers_flashing_for_serial_ports_only(capsys):
    assert main(["doctor", "--port", "recording:x"]) == 2
    assert "flash" not in capsys.readouterr().out
