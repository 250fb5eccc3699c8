"""Everything at once: the scenario of the package, in simulated and in real time."""

import json
from collections import deque

import pytest

from fault_streams import frames
from spots.cli import main
from spots.connect import open_virtual
from spots.errors import SpotsError
from spots.sim.faults import Ledger
from spots.sim.files import DATA
from spots.soak import Audit, recoveries


def run(capsys, *arguments):
    assert main([*arguments, "--json"]) == 0
    return json.loads(capsys.readouterr().out.splitlines()[-1])


@pytest.fixture(scope="module")
def quiet_fire(tmp_path_factory):
    """`fire` without what acts on board and bus: only the bytes are damaged."""
    lines = (DATA / "scenarios" / "fire.toml").read_text().split("[faults.i2c]")
    path = tmp_path_factory.mktemp("scenarios") / "quiet.toml"
    path.write_text(lines[0] + "[[touch]]" + lines[1].split("[[touch]]", 1)[1])
    return str(path)


def test_the_seed_decides_everything(capsys):
    fire = ("demo", "--fast", "--scenario", "fire", "--seconds", "25")
    first, again = run(capsys, *fire), run(capsys, *fire)
    assert first == again
    assert first["restarts"] == 1
    assert run(capsys, *fire, "--seed", "1")["stream_sha256"] != first["stream_sha256"]


def test_a_minute_of_fire_delivers_nothing_wrong_and_loses_only_what_was_touched(capsys):
    ledger = run(capsys, "soak", "--hours", str(61 / 3600), "--seed", "3")
    assert ledger["wrong"] == 0
    assert ledger["lost"]["undamaged"] == 0
    assert ledger["lost"]["damaged"] > 0
    sent, delivered = sum(ledger["sent"].values()), sum(ledger["delivered"].values())
    assert sent == delivered + ledger["lost"]["damaged"]
    assert ledger["restarts_noticed"] == ledger["faults"]["power.brown_outs"] == 2
    assert ledger["recoveries"]["power.brown_outs"]["count"] == 2
    assert ledger["readings_percent"] > 85
    assert ledger == run(capsys, "soak", "--hours", str(61 / 3600), "--seed", "3")


def test_damage_on_the_way_does_not_change_what_the_board_sends(capsys, quiet_fire, monkeypatch):
    sent = []
    send = Audit.send

    def remember(self, data, now_s):
        sent.append(data)
        send(self, data, now_s)

    def untouched(self, data, now_us):
        self.passed += len(data)
        return data

    monkeypatch.setattr(Audit, "send", remember)
    assert run(capsys, "soak", "--hours", "0.008", "--faults", quiet_fire)["lost"]["damaged"]
    damaged, sent[:] = b"".join(sent), []
    monkeypatch.setattr("spots.sim.faults.Damage.__call__", untouched)
    run(capsys, "soak", "--hours", "0.008", "--faults", quiet_fire)
    assert b"".join(sent) == damaged


def test_a_soak_without_faults_is_refused(capsys):
    assert main(["soak", "--faults", "demo"]) == 2
    assert "has no [faults]; try 'fire'" in capsys.readouterr().err


def test_the_table_is_for_people(capsys):
    assert main(["soak", "--hours", "0.003"]) == 0
    said = capsys.readouterr().out
    assert "wrong 0" in said
    assert "i2c.nack" in said


class Streams:
    def __init__(self):
        self.pieces = frames(20, texts=False)

    def audit(self, received, touched=()):
        made = Audit(deque(touched))
        made.send(b"".join(self.pieces), 0.0)
        made.receive(received, 1.0)
        made.finish()
        return made


def test_the_audit_finds_a_loss_without_damage():
    streams = Streams()
    whole = b"".join(streams.pieces)
    assert not streams.audit(whole).lost
    cut = b"".join(streams.pieces[:4] + streams.pieces[5:])
    assert streams.audit(cut).lost == {"undamaged": 1}
    first = sum(map(len, streams.pieces[:4]))
    end = first + len(streams.pieces[4])
    for at in (first - 1, first, end - 1):  # the delimiter before it counts
        assert streams.audit(cut, [at]).lost == {"damaged": 1}
    assert streams.audit(cut, [first - 2]).lost == {"undamaged": 1}
    assert streams.audit(cut, [end]).lost == {"undamaged": 1}


def test_the_audit_finds_a_wrong_frame_and_one_out_of_its_order():
    streams = Streams()
    other = frames(1, seed=9, texts=False)
    assert len(streams.audit(b"".join(streams.pieces + other)).wrong) == 1
    a, b, *rest = streams.pieces
    assert len(streams.audit(b"".join([b, a, *rest])).wrong) == 1
    assert len(streams.audit(b"".join([a, a, b, *rest])).wrong) == 1


def test_a_soak_with_a_wrong_frame_ends_with_a_sentence(monkeypatch):
    from spots import soak

    ledger = {"wrong": 2, "lost": {"undamaged": 0}}
    monkeypatch.setattr(soak, "soak", lambda *arguments: ledger)
    with pytest.raises(SpotsError, match="2 wrong frames were delivered"):
        soak.run(1.0, "fire", 0, "default", True)


def test_recoveries_are_from_the_begin_of_a_fault_to_the_next_reading():
    ledger = Ledger()
    arrivals_s = [0.01 * i for i in range(100)] + [1.8 + 0.01 * i for i in range(100)]
    ledger.spells += [("power.brown_outs", 1e6, 1.1e6), ("to_host.bursts", 1e6, 2e6)]
    ledger.spells += [("i2c.sda_low", 0.5e6, 9e6), ("clock.stalls", 9e6, 9.1e6)]
    found = recoveries(ledger, arrivals_s)
    assert set(found) == {"power.brown_outs", "i2c.sda_low"}
    assert found["power.brown_outs"] == {"count": 1, "median_s": 0.8, "longest_s": 0.8}
    assert found["i2c.sda_low"]["longest_s"] <= 0.16


def test_in_real_time_a_program_goes_on_as_well(tmp_path):
    path = tmp_path / "blaze.toml"
    path.write_text(
        "seconds = 100.0\n"
        "[[touch]]\npoints = [[0, 40.0, 3000], [99, 40.0, 3000]]\n"
        "[faults]\nfrom_s = 6.0\n"
        "[faults.to_host]\nflip_percent = 0.5\n"
        "[faults.i2c]\nnack_percent = 0.5\nsda_low = { at_s = [6.5], last_ms = 60000.0 }\n"
        "[faults.power]\nbrown_outs = { at_s = [7.0] }\n"
        "[faults.clock]\noscillator_ppm = 200\nstalls = { at_s = [9.5], last_ms = 60.0 }\n"
    )
    board, _ = open_virtual("default", str(path), 0)
    with board:
        board.command("save")
        after = 0
        for touch in board.touches(60.0):
            if board.stats.restarts and touch.trusted:
                assert touch.position_um == pytest.approx(40_000, abs=1000)
                after += 1
            if after == 300:
                break
        assert after == 300
        assert board.stats.restarts == 1
        assert board.stats.bad_crc > 0
