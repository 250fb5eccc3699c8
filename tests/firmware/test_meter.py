"""While a sample's cost is measured, the board listens as often as else."""

from bench import canned

SLICE_US = 10_000


class Serial(canned.Serial):
    """A port that keeps when it was asked."""

    def __init__(self):
        super().__init__()
        self.clock, self.asked_us = None, []

    def read(self):
        if self.clock:
            self.asked_us.append(self.clock.now)
        return -1


def test_a_measured_pass_is_deaf_for_a_slice_at_most(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    app, _, clock, serial = canned.app((), Serial())
    app.settings.values["exposure_us"] = 30_000
    app.restart()
    app.measure()
    serial.clock = clock
    while "step" in vars(app):
        app.step()
    assert app.meter.busy_us < SLICE_US
    gaps_us = [b - a for a, b in zip(serial.asked_us, serial.asked_us[1:])]
    assert len(gaps_us) > 30
    assert max(gaps_us) <= SLICE_US
