"""Figures of `spots characterize`, and the response of strips, which depends only on the dye."""

from unittest.mock import create_autospec

import numpy as np
import pytest
from make import paper
from make.paper import document, rows

from spots_sim.measure import figures
from spots_sim.measure.family import Response, departure_um, family
from spots_sim.measure.measurements import BENDS_DEG, STRAINS_PERCENT, Run

NAMES = {"position", "resolution", "dye_and_length", "force", "strain", "bending", "joint"}


@pytest.fixture(scope="module")
def responses(sensor):
    return family(sensor, ("F5", "F8"), seed=0, exposure_us=10_000)


@pytest.fixture
def run():
    """A `Run` with invented values."""
    x_um = np.linspace(4000, 80_000, 19)
    ones = np.ones(19)
    position = dict.fromkeys(("resolution", "accuracy", "scatter", "bound", "pair"), ones)
    position |= {"x_um": x_um, "along_um": x_um, "log_ratio": x_um / 1e5, "channels": ["F5", "F8"]}
    joint = {"direction": np.array([1, 1, -1, -1]), "angle_deg": np.array([0, 1, 1, 0])}
    joint |= {"position_um": np.arange(4.0), "error_deg": np.arange(4.0)}
    found = np.array([x_um, ones, ones])
    strain = {"accuracy": found, "along_um": x_um, "log_ratio": x_um / 1e5}
    force = {name: np.arange(4.0) for name in ("force_mN", "error_mN", "brightness")}
    return Run(
        {
            "position": {
                "r2": 0.9991234,
                "resolution_um": 7.25,
                "accuracy_um": 1,
                "crb_ratio": 1.02,
                "one_pair": {"channels": ["F5", "F8"], "crb_ratio": 1.57},
            },
            "force": {
                "resolution_mN": 5, "bound_mN": 4.25, "accuracy_N": 0.1, "threshold_mN": 200
            },
            "joint": {
                "r2": 0.9999, "resolution_deg": 0.1, "accuracy_deg": 0.1, "backlash_deg": 0.02
            },
            "strain": [{"percent": p, "accuracy_um": 30 + p} for p in STRAINS_PERCENT],
            "bend": [{"degrees": d, "accuracy_um": d} for d in BENDS_DEG],
            "snr_db": 60,
            "reading_ms": 10,
        },
        {
            "position": position,
            "force": force | {"share": np.array([0.1, 0.1, 0.9, 0.9])},
            "strain": dict.fromkeys(STRAINS_PERCENT, strain),
            "bend": dict.fromkeys(BENDS_DEG, found),
            "joint": joint,
        },
    )  # fmt: skip


@pytest.mark.board
def test_no_title_runs_out_of_its_figure(run, responses):
    for name in ("_position", "_resolution", "_force", "_strain", "_bending", "_joint"):
        draw = getattr(figures, name)
        figure = draw(run) if name == "_position" else draw(run, "99.9 ms a reading")
        figure.canvas.draw()
        for axis in figure.axes:
            title = axis.get_title(loc="left")
            assert title
            box = axis._left_title.get_window_extent()
            assert box.x1 <= figure.bbox.x1, title


def test_the_straightness_of_the_response_is_that_of_the_curve_below_it(run):
    position = run.series["position"]
    position["log_ratio"] = position["x_um"] / 1e5 + (position["x_um"] / 1e5) ** 2
    residual = position["log_ratio"] - np.polyval(
        np.polyfit(position["x_um"], position["log_ratio"], 1), position["x_um"]
    )
    r2 = 1 - np.var(residual) / np.var(position["log_ratio"])
    assert f"R² = {r2:.6f}" in figures._position(run).axes[0].get_title(loc="left")


def test_strips_of_the_same_dye_share_one_response(responses):
    assert departure_um(responses["length"]) < 250


def test_another_dye_departs(responses):
    assert departure_um({85.0: responses["dye"][1.0], 84.0: responses["dye"][2.0]}) > 5000


def test_the_slope_goes_with_the_dye(responses):
    half, _, double = (
        np.polyfit(r.x_um, r.log_ratio, 1)[0] for _, r in sorted(responses["dye"].items())
    )
    assert double / half == pytest.approx(4, rel=0.1)


def test_departure_is_measured_along_the_strip():
    x_um = np.linspace(0, 100_000, 20)
    far = Response(x_um, 2e-5 * x_um)
    near = Response(x_um[:8], 2e-5 * (x_um[:8] + 30))
    assert departure_um({100.0: far, 40.0: near}) == pytest.approx(30)


def test_the_document_has_what_was_measured_and_what_cannot_be(run):
    page = document([run] * 4, [42.0, 6.0], 85.0)
    for number in (
        "7.2 µm",
        "1.02",
        "1.57",
        "0.9991234",
        "4.2 mN",
        "within 42 µm",
        "30.0 µm, then 35.0 to",
    ):
        assert number in page
    assert all(len(row[3]) == 2 and row[4].endswith(".") for row in rows([run, run], [42.0, 6.0]))
    for name in NAMES:
        assert f"(../pictures/paper/{name}.png)" in page


@pytest.mark.board
def test_the_program_of_the_page_writes_it_and_its_figures(run, responses, tmp_path, monkeypatch):
    for name, result in (("characterize", run), ("family", responses)):
        stub = create_autospec(getattr(paper, name), return_value=result)
        monkeypatch.setattr(paper, name, stub)
    paper.main(tmp_path)
    assert "| 7 µm |" in (tmp_path / "evidence" / "paper.md").read_text(encoding="utf-8")
    drawn = [*(tmp_path / "pictures" / "paper").iterdir()]
    assert {path.name for path in drawn} == {f"{name}.png" for name in NAMES}
    for path in drawn:
        data = path.read_bytes()
        assert data.startswith(b"\x89PNG")
        assert 5_000 < len(data) < 200_000
