"""``spots record``, ``replay`` and ``info``, and their errors."""

import json
import os
import pty
import signal
import subprocess
import sys

import pytest
from support.frames import stream
from support.reels import record, recorder, replayed
from support.refusals import refusal

import spots
from spots import cli
from spots.calibrate import calibration_file as file
from spots.errors import FileError, SettingError
from spots.link.decoder import note
from spots.link.frames import Spectrum, Touch
from spots.recording.header import Clock, Header, encoded
from spots.terminal.view import plain
from spots_device.reading.calibration import Conditions


@pytest.fixture
def fast(opened, monkeypatch):
    """Board in simulated time, which the command line opens for any port."""
    board = opened()
    board.close = lambda: None
    monkeypatch.setattr(cli.arguments, "open_board", lambda options: board)
    return board


def refused(capsys, *arguments):
    assert cli.main([str(argument) for argument in arguments]) == 2
    output = capsys.readouterr()
    assert output.out == ""
    return output.err


@pytest.mark.board
def test_record_then_replay_shows_what_monitor_shows(fast, tmp_path, capsys):
    path = tmp_path / "run.spots"
    assert cli.main(["record", str(path), "--seconds", "1.5"]) == 0
    output = capsys.readouterr()
    assert output.out == ""
    assert output.err.startswith(f"{path}: 1.5 s, ")
    assert output.err.count("\n") == 1
    frames, recording = replayed(path)
    assert {Touch, Spectrum} < {type(frame) for frame in frames}
    assert recording.complete
    assert cli.main(["replay", str(path), "--speed", "inf"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert 4 <= len(lines) <= 7
    started_s = recording.header.host_s
    assert set(lines) <= {plain(one, started_s) for one in frames if isinstance(one, Touch)}
    # The recording begins and ends at unknown times between the taps of the scenario.
    assert any(" mm" in line for line in lines)
    assert any("no touch" in line for line in lines)
    assert cli.main(["monitor", "--port", f"recording:{path}", "--seconds", "0.1"]) == 0


@pytest.mark.board
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_ends_a_recording_of_the_virtual_board_cleanly(tmp_path, number):
    path = tmp_path / "run.spots"
    command = [sys.executable, "-m", "spots", "record", str(path), "--port", "virtual"]
    behind, front = pty.openpty()
    process = subprocess.Popen(command, stderr=front, stdin=subprocess.DEVNULL)
    os.close(front)
    shown = b""
    while shown.count(b" frames") < 4:
        shown += os.read(behind, 1000)
    process.send_signal(number)
    assert process.wait() == (0 if number == signal.SIGINT else -number)
    shown += os.read(behind, 1000)
    os.close(behind)
    assert b"Traceback" not in shown
    last = shown.decode().strip().split("\r")[-1]
    frames, recording = replayed(path)
    assert recording.complete
    told = int(last.split(" frames")[0].split()[-1])
    readings = [frame for frame in frames if isinstance(frame, (Touch, Spectrum))]
    assert 0 < told <= len(readings)
    assert recording.header.calibration


@pytest.mark.board
def test_rotation_by_the_command(fast, tmp_path, capsys):
    path = tmp_path / "run.spots"
    assert cli.main(["record", str(path), "--seconds", "20", "--rotate-mb", "0.1"]) == 0
    assert "run.spots … run-00" in capsys.readouterr().err
    assert len(replayed(path)[1].paths) > 1


@pytest.mark.board
def test_a_board_that_goes_away_leaves_its_recording(fast, tmp_path, capsys):
    path = tmp_path / "run.spots"
    read = fast._link.read
    left = [400]

    def breaking(timeout_s):
        left[0] -= 1
        if not left[0]:
            raise spots.SpotsError("the board was disconnected")
        return read(timeout_s)

    fast._link.read = breaking
    error = refused(capsys, "record", path)
    kept, complaint = error.splitlines()
    assert kept.startswith(f"{path}: ")
    assert complaint == "spots: the board was disconnected"
    assert len(replayed(path)[0]) > 100


def test_a_full_disk_is_told_and_what_was_written_stays(tmp_path, full_disk):
    tap = recorder(tmp_path / "run.spots", stream(200))
    ended = refusal(FileError, file="run.spots")
    with full_disk(2000), ended:
        all(tap.read(1) for _ in range(200))
    frames, recording = replayed(tmp_path / "run.spots")
    assert len(frames) > 10
    assert not recording.complete
    assert tap.read(1)  # the link continues after the end of the recording
    tap.stop()
    assert recording.size == (tmp_path / "run.spots").stat().st_size


@pytest.mark.board
def test_a_calibration_file_has_to_be_that_of_the_board(fast, tmp_path, capsys):
    path = tmp_path / "other.toml"
    path.write_text("colour = 3\n")
    error = refused(capsys, "record", tmp_path / "a.spots", "--calibration", path)
    assert "other.toml" in error
    assert not (tmp_path / "a.spots").exists()


@pytest.mark.board
def test_the_calibration_is_recorded_where_a_file_has_it(fast, calibration, tmp_path, capsys):
    fast.calibration = None
    made = Conditions(fast.info["id"], tuple(fast.info["channels"]), 9, 10_000, 20)
    lines = tuple(calibration)
    mine = file.CalibrationFile(date=file.now(), **made._asdict(), lines=lines)
    file.save(mine, tmp_path / "mine.toml", None)
    arguments = ["--seconds", "0.1", "--calibration", tmp_path / "mine.toml"]
    assert cli.main(["record", *map(str, [tmp_path / "a.spots", *arguments])]) == 0
    assert replayed(tmp_path / "a.spots")[1].header.calibration == calibration
    capsys.readouterr()
    fast.command("cal clear")
    error = refused(capsys, "record", tmp_path / "b.spots", *arguments)
    assert "the board uses no calibration, but the calibration file has" in error


def bad(tmp_path, content):
    path = tmp_path / "bad.spots"
    path.write_bytes(content)
    return path


@pytest.mark.parametrize("command", [["info"], ["replay"], ["export", "--to", "csv"]])
@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (b"", "is not a recording"),
        (b"time,force\n1,2\n" * 500, "is not a recording"),
        (bytes(5000), "is not a recording"),
        (b"".join(stream(100)), "is not a recording"),
    ],
)
def test_a_file_that_is_no_recording(tmp_path, capsys, command, content, sentence):
    path = bad(tmp_path, content)
    error = refused(capsys, command[0], path, *command[1:])
    assert error.startswith(f"spots: {path} {sentence}")
    assert error.count("\n") == 1


def test_files_that_cannot_be_opened(tmp_path, capsys):
    assert f"there is no file {tmp_path}/no" in refused(capsys, "info", tmp_path / "no")
    assert "is a folder, not a recording: name a file" in refused(capsys, "info", tmp_path)


def headed(**changes):
    fields = {"recording": 1, "program": "", "set": "", "part": 0, "host_s": 0.0, "utc_s": 0.0}
    clock = Clock(last_us=0, low_s=0.0, high_s=0.0)
    return Header(**{**fields, "info": {}, "clock": clock, **changes})


def test_a_header_cut_short_and_one_of_a_later_version(tmp_path, capsys):
    path = tmp_path / "a.spots"
    record(path, stream(3))
    data = path.read_bytes()
    cut = bad(tmp_path, data[:400])
    assert "its header is damaged or incomplete" in refused(capsys, "info", cut)
    header = headed(recording=2)
    later = bad(tmp_path, encoded(header))
    assert "has format version 2, but this program reads 1: update" in refused(
        capsys, "info", later
    )


def test_a_recording_of_a_board_of_another_protocol(tmp_path, capsys):
    info = {"protocol": 7}
    header = headed(program="spots 9", info=info)
    path = bad(tmp_path, encoded(header) + stream(1)[0])
    assert (
        "with protocol 7, but this program reads 3: read the file with the program that wrote it, "
        "spots 9" in refused(capsys, "replay", path)
    )


def test_a_header_that_is_none_of_ours(tmp_path, capsys):
    header = headed(host_s="x")
    assert "has an invalid header" in refused(capsys, "info", bad(tmp_path, encoded(header)))
    for content in ({"header": 5, "i": 0, "of": 1}, {"header": "[]", "i": 0, "of": 1}):
        path = bad(tmp_path, note(0, content))
        assert "has an invalid header" in refused(capsys, "info", path)
    deep = [note(0, {"header": "[" * 500, "i": i, "of": 200}) for i in range(200)]
    assert "has an invalid header" in refused(capsys, "info", bad(tmp_path, b"".join(deep)))
    path = bad(tmp_path, note(0, {"header": "", "i": []}))
    assert "is not a recording" in refused(capsys, "info", path)


@pytest.mark.board
def test_a_recording_never_writes_over_a_file(fast, tmp_path, capsys):
    path = bad(tmp_path, b"mine")
    assert f"{path} exists: choose another name" in refused(
        capsys, "record", path, "--seconds", "0.1"
    )
    assert path.read_bytes() == b"mine"
    assert f"there is no folder {tmp_path}/no" in refused(
        capsys, "record", tmp_path / "no" / "a.spots"
    )


@pytest.mark.parametrize("speed", ["0", "-1", "nan", "x"])
def test_a_speed_that_is_none(capsys, speed, tmp_path):
    with pytest.raises(SystemExit):
        cli.main(["replay", "a", "--speed", speed])
    assert "a speed must be a number from" in capsys.readouterr().err
    record(tmp_path / "a.spots", stream(1))
    with refusal(SettingError):
        spots.open_recording(tmp_path / "a.spots", -1.0)


def test_info_of_a_recording_that_broke_off(tmp_path, capsys):
    path = tmp_path / "a.spots"
    record(path, stream(20))
    os.truncate(path, path.stat().st_size - 60)
    assert cli.main(["info", "--json", str(path)]) == 0
    found = json.loads(capsys.readouterr().out)
    assert not found["complete"]
    assert 0 < found["frames"]["touch"] < 20
    assert cli.main(["info", str(path)]) == 0
    assert "cut off, or still being recorded" in capsys.readouterr().out
