"""`spots twin` with live and recorded boards, restarts, linkage files, and its output."""

from __future__ import annotations

import io
import json
import math
import runpy
import sys
from contextlib import ExitStack
from pathlib import Path
from types import SimpleNamespace

import msgspec
import numpy as np
import pytest
from rich.console import Console
from support.joints import JOINT
from support.joints import touch as reading
from support.linkage_machine import Machine
from support.refusals import refusal

import spots
from spots import SpotsError, cli
from spots.calibrate import calibration_file as file
from spots.errors import BoardError, CalibrationError, FileError, RefusedError
from spots.link.board import Board
from spots.link.frames import LinkStats
from spots_linkage import Encoder, Linkage, Twin, mounted, twin_source
from spots_linkage import twin as twin_command
from spots_linkage.mounted import Mounted, Mounting
from spots_linkage.twin_view import TwinView
from spots_sim.demo import linkage_demo
from spots_sim.measure.simulated_linkage import START_S
from spots_sim.strip.files import (
    FaultsFile,
    Moments,
    PowerFaults,
)

EXAMPLES = Path(__file__).parents[2] / "examples"
BROWN_OUT = FaultsFile(power=PowerFaults(brown_outs=Moments(at_s=[4.0], last_ms=200)))


@pytest.fixture(scope="module")
def built(sensor, tmp_path_factory):
    return Machine(sensor, tmp_path_factory.mktemp("arm"))


@pytest.fixture
def machine(built, monkeypatch):
    built.faults = {}
    monkeypatch.setattr(twin_source, "open", built.open)
    return built


def told(arm, ports, record=(), seconds=None):
    with twin_source.opened(arm, ports, record) as source:
        terminals = list(source.twin.follow(source.readings(seconds)))
        return terminals, [board.stats for board in source.boards]


def test_boards_tell_where_the_terminal_is_and_their_recordings_tell_the_same(machine, tmp_path):
    paths = [tmp_path / "a.spots", tmp_path / "b.spots"]
    live, _ = told(machine.arm, ["0", "1"], paths, 4.0)
    assert len(live) > 200
    time_s, x_mm, y_mm = np.array([(t.time_s, t.x_mm, t.y_mm) for t in live]).T
    true_x, true_y = machine.motion.at(time_s)
    assert np.hypot(x_mm - true_x, y_mm - true_y)[time_s > START_S].max() < 0.5
    assert np.ptp(x_mm) > 10
    again, _ = told(machine.arm, [f"recording:{path}" for path in paths])
    assert again == live
    some, _ = told(machine.arm, [f"recording:{path}" for path in paths], seconds=2.0)
    assert some == live[: len(some)]
    assert 0.4 * len(live) < len(some) < 0.6 * len(live)


@pytest.mark.board
def test_a_board_that_restarts_gets_its_calibration_again_and_so_does_the_recording(
    machine, tmp_path
):
    machine.faults = {1: BROWN_OUT}
    paths = [tmp_path / "a.spots", tmp_path / "b.spots"]
    live, stats = told(machine.arm, ["0", "1"], paths, 8.0)
    assert [one.restarts for one in stats] == [0, 1]
    time_s = np.array([t.time_s for t in live])
    assert (time_s < 4).sum() > 100
    assert (time_s > 7).sum() > 50
    true_x, true_y = machine.motion.at(time_s)
    off_mm = np.hypot([t.x_mm for t in live] - true_x, [t.y_mm for t in live] - true_y)
    assert off_mm[time_s > START_S].max() < 0.5
    again, _ = told(machine.arm, [f"recording:{path}" for path in paths])
    assert again == live


def test_a_board_that_refuses_after_a_restart_is_asked_again_for_a_while():
    refused = []

    def restarted(board):
        refused.append(board.now_s())
        raise BoardError("the board refuses", "no_bus")

    stats, clock = LinkStats(), iter(np.arange(0, 100, 0.5))

    def within(seconds):
        stats.restarts = 1
        return iter(())

    board = SimpleNamespace(
        command=lambda line: {},
        now_s=lambda: float(next(clock)),
        touches=lambda: SimpleNamespace(within=within),
        stats=stats,
        ended=False,
    )
    pairs = twin_source.readings([board], (0,), None, restarted)
    stats.restarts = 0
    with refusal(BoardError, why="no_bus"):
        next(pairs)
    assert refused[-1] - refused[0] >= 10


@pytest.mark.board
@pytest.mark.parametrize("ports", [("0", "1"), ()])
def test_the_example_of_a_twin(ports, machine, capsys, monkeypatch):
    # The example runs for ever, so the test limits it to 3 s.
    source = twin_source.Source
    monkeypatch.setattr(source, "follow", lambda it: it.twin.follow(it.readings(3.0)))
    monkeypatch.setattr(
        "spots_sim.measure.simulated_linkage._strips", lambda *_: [machine.strip] * 2
    )
    arguments = [machine.arm, *ports] if ports else []
    monkeypatch.setattr(sys, "argv", ["twin.py", *map(str, arguments)])
    runpy.run_path(str(EXAMPLES / "twin.py"), run_name="__main__")
    lines = capsys.readouterr().out.splitlines()
    told = np.array([[float(word) for word in line.split()[:2]] for line in lines])
    assert len(told) > 10
    # The points are on the path, at times that depend on the load of the machine.
    for of_axis, path_mm in zip(told.T, (machine.motion.x_mm, machine.motion.y_mm)):
        assert of_axis.min() > path_mm.min() - 1
        assert of_axis.max() < path_mm.max() + 1
    assert np.ptp(told, axis=0).max() > 3


@pytest.mark.board
@pytest.mark.parametrize("virtual", [False, True])
def test_the_example_that_tracks_a_joint(virtual, machine, capsys, monkeypatch):
    touches = Board.touches
    monkeypatch.setattr(Board, "touches", lambda board: touches(board, 3.0))
    monkeypatch.setattr(spots, "open", machine.open)
    monkeypatch.setattr(
        "spots_sim.measure.simulated_linkage._strips", lambda *_: [machine.strip] * 2
    )
    arguments = [] if virtual else [machine.arm.parent / "strip.toml", "1"]
    monkeypatch.setattr(sys, "argv", ["track_joint.py", *map(str, arguments)])
    runpy.run_path(str(EXAMPLES / "track_joint.py"), run_name="__main__")
    lines = capsys.readouterr().out.splitlines()
    told_deg = np.array([float(line.split()[0]) for line in lines])
    assert len(told_deg) > 20
    path_deg = machine.mechanism.angles_deg(machine.motion.x_mm, machine.motion.y_mm)
    of_joint = path_deg[0] + math.degrees(machine.mechanism.zero_rad[0]) if virtual else path_deg[1]
    assert told_deg.min() > of_joint.min() - 0.3
    assert told_deg.max() < of_joint.max() + 0.3
    assert np.ptp(told_deg) > 3
    if not virtual:
        assert told_deg[:5] == pytest.approx(of_joint[0], abs=0.25)


def test_lines_for_programs(machine, capsys):
    arguments = ["twin", "--linkage", str(machine.arm), "--port", "0", "--port", "1"]
    assert cli.main([*arguments, "--seconds", "2", "--json"]) == 0
    lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert len(lines) > 80
    assert lines[-1].keys() == {
        *("time_s", "x_mm", "y_mm", "velocity_mm_s", "cov", "sigma_mm"),
        *("theta1_rad", "theta2_rad", "limit", "singular", "within"),
    }
    assert lines[-1]["limit"] is None
    assert len(lines[-1]["velocity_mm_s"]) == 2


def test_lines_for_people(machine, capsys):
    arguments = ["twin", "--linkage", str(machine.arm), "--port", "0", "--port", "1"]
    assert cli.main([*arguments, "--seconds", "2"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert 6 <= len(lines) <= 9
    assert all("end point" in line and "mm/s" in line for line in lines[1:])


def test_boards_are_found_by_their_ids_in_the_order_of_the_joints(machine, monkeypatch):
    names, closed, given = ["B", "C", "A"], [], []

    class There:
        read_only = ended = False

        def __init__(self, name):
            self.info, self.port, self.stats = {"id": name}, f"port {name}", LinkStats()

        def __enter__(self):
            return self

        def __exit__(self, *exception):
            closed.append(self.port)

        sensors = range(1)

        def command(self, line):
            return self.info

        def now_s(self):
            return 0.0

        def close(self):
            closed.append(self.port)

    strips = [SimpleNamespace(board=name, joint=JOINT, lines=(name,)) for name in "AB"]
    monkeypatch.setattr(Mounted, "strips", lambda self, path: strips)
    monkeypatch.setattr(twin_source, "find", lambda: ([There(name) for name in names], []))
    monkeypatch.setattr(
        twin_source, "prepare", lambda board, lines, _: given.append((board.port, *lines))
    )
    with twin_source.opened(machine.arm) as source:
        assert [board.port for board in source.boards] == ["port A", "port B"]
        assert given == [("port A", "A"), ("port B", "B")]
        assert closed == ["port C"]
    names.remove("A")
    with refusal(CalibrationError), ExitStack() as stack:
        stack.enter_context(twin_source.opened(machine.arm))
    assert closed.count("port B") == 2


def test_the_picture_names_what_is_wrong():
    linkage = Linkage((100, 45, 45, 100), 80)
    twin = Twin(linkage, (Encoder(JOINT), Encoder(JOINT)))
    view = TwinView(twin, ["here", "there"])

    def seen(now_s=0.1):
        console = Console(width=90, record=True, file=io.StringIO())
        console.print(view.picture([LinkStats(), LinkStats(lost=3)], now_s))
        return console.export_text()

    assert "no angle of joint 1 and joint 2" in seen()
    for i, angle in enumerate((0.1, 0.11, 0.12, -1.0)):
        position_um = (math.degrees(angle) + 20) / 0.002
        for joint in (0, 1):
            twin.take(joint, reading(position_um, i, time_s=0.03 * i))
        if angle == 0.12:
            text = seen()
            assert f"{twin.trail[-1].x_mm:.2f}  {twin.trail[-1].y_mm:.2f} mm" in text
            assert "mm/s" in text
            assert "one sigma" in text
            assert "●" in text
            assert "lost 3" in text
            assert "no angle" not in text
    text = seen()
    assert twin.trail[-1].limit.sentence in text
    assert "●" not in text
    twin.take(1, reading(position_um, 50, time_s=4.0))
    assert "no angle of joint 1: check that" in seen(4.0)


HEAD = "bar_mm = [100, 100, 100, 100]\nbase_mm = 80\n"
JOINTS = '[[joint]]\ncalibration = "strip.toml"\noffset_deg = -108\n' * 2


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("bar_mm = [100", "linkage file .*arm.toml: "),
        (HEAD + JOINTS + "[grip]\n", "unknown key 'grip'"),
        ("base_mm = 80\n" + JOINTS, "the key 'bar_mm' is missing: add it"),
        (HEAD + "[[joint]]\ncalibration = 'a'\noffset_deg = 0\n", "there are 1 .*linkage has two"),
        (HEAD.replace("80", "800") + JOINTS, "must be below the sum of the other lengths"),
        (
            "bar_mm = [0.1, 0.1, 0.1, 0.1]\nbase_mm = 0.08\n" + JOINTS,
            "entry 1 of bar_mm must be .* at least 1",
        ),  # in m
        (HEAD + "assembly = 'up'\n" + JOINTS, "'far' or 'near', not 'up'"),
        (HEAD + JOINTS + "gain = 0\n", r"gain must be about 1, .* \(entry 2 of joint\)$"),
        (HEAD + JOINTS + "offset_deg = nan\n", "arm.toml: "),
        (HEAD + JOINTS.replace("strip", "none"), "joint 1: there is no file .*none.toml"),
        (
            HEAD + JOINTS.replace("strip", "bare"),
            "joint 1: .*bare.toml is not the calibration of a joint: run",
        ),
    ],
)
def test_a_linkage_file_that_is_wrong_says_where(text, words, machine, tmp_path, capsys):
    file.save(machine.strip, tmp_path / "strip.toml", None)
    file.save(msgspec.structs.replace(machine.strip, joint=None), tmp_path / "bare.toml", None)
    arm = tmp_path / "arm.toml"
    arm.write_text(text)
    with pytest.raises(SpotsError, match=words):
        told(arm, ["0", "1"])
    assert cli.main(["twin", "--linkage", str(arm), "--port", "0", "--port", "1"]) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_a_linkage_file_is_written_as_it_is_read(tmp_path):
    joints = [
        Mounting(calibration='odd "name".toml', offset_deg=-107.9, gain=-1.01),
        Mounting(calibration="b/\N{GRINNING FACE}.toml", offset_deg=3.0),
    ]
    arm = Mounted(bar_mm=(101.0, 99.25, 100.0, 99.0), base_mm=80.7, assembly="near", joint=joints)
    mounted.save(
        arm, tmp_path / "arm.toml", mounted.KIND.present(tmp_path / "arm.toml"), "two\nlines"
    )
    assert mounted.load(tmp_path / "arm.toml") == arm
    assert mounted.is_mounted(tmp_path / "arm.toml")
    assert not mounted.is_mounted("default")
    with refusal(FileError, file="no"):
        mounted.save(arm, tmp_path / "no" / "arm.toml", None)
    with refusal(FileError, file="nope.toml"):
        mounted.load("nope.toml")


def test_a_recording_of_another_board_or_calibration_is_refused(machine, tmp_path):
    paths = [tmp_path / "a.spots", tmp_path / "b.spots"]
    told(machine.arm, ["0", "1"], paths, 0.1)
    ports = [f"recording:{path}" for path in paths]
    with refusal(RefusedError):
        twin_source.give(
            SimpleNamespace(command=lambda _: {"id": "feed"}, port="x", sensors=range(1)),
            machine.strip,
            2,
        )
    lines = (*machine.strip.lines[:-1], machine.strip.lines[-1] + " ")
    other = msgspec.structs.replace(machine.strip, lines=lines)
    file.save(other, tmp_path / "strip.toml", None)
    arm = tmp_path / "arm.toml"
    arm.write_text(machine.arm.read_text())
    with refusal(CalibrationError):
        told(arm, ports)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--port", "0"], "both joints have the calibration of strip 0"),
        (["--port", "0", "--port", "1", "--port", "0"], "but --port was given 3 times"),
        (["--port", "0", "--port", "1", "--record", "a"], "give it once for each board"),
        (["--port", "recording:a", "--port", "1"], "only one --port is a recording"),
        (["--port", "recording:nope", "--port", "recording:nope"], "there is no file nope"),
        (["--port", "recording:a", "--measure", "p.csv"], "--measure needs real boards"),
        (["--port", "virtual"], "arm.toml is the file of a linkage with real boards: leave"),
        (
            ["--port", "0", "--port", "1", "--picture", "a.png"],
            "--picture shows a simulated linkage",
        ),
        (["--port", "0", "--measure", "p.csv", "--picture", "a.png"], "--picture shows"),
        (
            ["--calibrate", "p.csv", "--port", "0"],
            "--calibrate reads a file of points and no board",
        ),
        (
            ["--calibrate", "p.csv", "--seconds", "3"],
            "--calibrate reads a file of points and no board",
        ),
        (["--calibrate", "p.csv", "--json"], "--calibrate reads a file of points and no board"),
        (["--out", "a.toml"], "--out writes what --calibrate finds"),
    ],
)
def test_options_that_do_not_go_together(arguments, words, machine, capsys):
    assert cli.main(["twin", "--linkage", str(machine.arm), *arguments]) == 2
    err = capsys.readouterr().err
    assert words in err
    assert err.count("\n") == 1


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--record", "a.spots"], "need boards: name the boards with --port"),
        (["--port", "virtual", "--measure", "p.csv"], "--measure needs real boards"),
        (["--port", "virtual", "--picture", "a.png"], "leave out --port, and name no"),
        (["--port", "virtual", "--port", "virtual"], "but --port was given 2 times: give --port"),
        (["--port", "virtual", "--port", "0"], "but --port was given 2 times: give --port"),
    ],
)
def test_what_a_simulation_cannot_do_is_refused(arguments, words, monkeypatch, capsys):
    monkeypatch.setattr(linkage_demo, "Endless", lambda *_: pytest.fail("simulated before"))
    assert cli.main(["twin", *arguments]) == 2
    assert words in capsys.readouterr().err


def test_recordings_without_a_terminal_are_an_error(machine, tmp_path, capsys):
    paths = [str(tmp_path / "a.spots"), str(tmp_path / "b.spots")]
    with twin_source.opened(machine.arm, ["0", "1"], paths):
        pass
    ports = [word for path in paths for word in ("--port", f"recording:{path}")]
    assert cli.main(["twin", "--linkage", str(machine.arm), *ports]) == 2
    assert "pressed at the same time" in capsys.readouterr().err


def test_what_is_wrong_with_a_recording_of_a_joint_is_printed(machine, tmp_path, capsys):
    paths = [tmp_path / "a.spots", tmp_path / "b.spots"]
    told(machine.arm, ["0", "1"], paths, 2.0)
    paths[1].write_bytes(paths[1].read_bytes()[:-100])
    ports = [word for path in paths for word in ("--port", f"recording:{path}")]
    assert cli.main(["twin", "--linkage", str(machine.arm), "--json", *ports]) == 0
    expected = f"spots: {paths[1]} is read to its end, but it has no end mark: "
    assert capsys.readouterr().err.startswith(expected)


def test_the_next_command_after_a_measurement_names_the_linkage_file(monkeypatch, capsys):
    monkeypatch.setattr(twin_command, "measure", lambda source, points: 4)
    twin_command._measure(None, Path("p.csv"), "arm.toml")
    expected = "p.csv has 4 points; next: spots twin --linkage arm.toml --calibrate p.csv\n"
    assert capsys.readouterr().out == expected


def test_a_line_is_out_when_it_is_told(monkeypatch):
    calls = []
    monkeypatch.setattr(twin_command, "line", lambda *_: "a line")
    monkeypatch.setattr("builtins.print", lambda *_, **options: calls.append(options))
    twin_command.Lines()(SimpleNamespace(time_s=0.0))
    assert calls == [{"flush": True}]


def test_a_simulated_linkage_is_followed_in_real_time(machine, monkeypatch, capsys):
    monkeypatch.setattr(
        "spots_sim.measure.simulated_linkage._strips", lambda *_: [machine.strip] * 2
    )
    figures = linkage_demo.demonstrate("default", 0, 1.0, fast=False, quiet=True)
    assert figures["terminals"] > 10
    assert figures["lost"] == 0
    capsys.readouterr()
