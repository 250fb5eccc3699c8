"""The recipe that `spots design --out` writes: its steps, and its amounts of material."""

import csv
import io
import re
import shlex

import pytest

from spots.cli import _parser, main
from spots_make import mould as strip_mould
from spots_make import parts
from spots_make import recipe as strip_recipe
from spots_make.shape import StripShape

DESIGN = "design --resolution-um 60 --rate-hz 100 --length-mm"


def written(folder, length_mm, *options):
    return main([*DESIGN.split(), str(length_mm), "--out", str(folder), *options])


@pytest.mark.board
def test_a_design_ends_with_something_to_make(tmp_path, capsys):
    assert written(tmp_path, 60, "--strips", "3") == 0
    listed = capsys.readouterr().err.split()
    assert {path.name for path in tmp_path.iterdir()} == {line.rsplit("/", 1)[1] for line in listed}
    text = (tmp_path / "build.md").read_text(encoding="utf-8")
    for named in re.findall(r"`(\w+\.(?:stl|svg))`", text):
        assert (tmp_path / named).stat().st_size > 500, named
    (command,) = re.findall(r"^ *(spots design .*)$", text, re.MULTILINE)
    options = _parser().parse_args(shlex.split(command)[1:])
    assert options.measure_dye
    assert options.length_mm == 60


def test_each_statement_of_the_instructions_has_a_source_or_is_not_tried(tmp_path):
    text = strip_recipe.text(StripShape(85), 1, 0.028, "spots design")
    assert "{" not in text
    rows = [line for part in ("Cast", "Assemble", "What goes wrong") for line in table(text, part)]
    assert len(rows) >= 20
    for row in rows:
        assert re.search(r"\*not tried\*|paper|bulletin|Smooth-On", row), row


def table(text, title):
    lines = text.split(f"## {title}\n")[1].split("\n## ")[0].splitlines()
    return [line for line in lines if line.startswith("|")][2:]


@pytest.mark.parametrize("strips", [1, 4, 30])
def test_each_batch_fills_its_cavities_with_spare(strips):
    shape = StripShape(85)
    batches = strip_recipe.batches(shape, strips)
    clear, test, dyed, support = batches
    assert clear.cavities_ml == pytest.approx(strips * shape.guide_mm3 / 1000 + test.cavities_ml)
    assert dyed.cavities_ml == pytest.approx(strips * shape.guide_mm3 / 1000)
    assert support.cavities_ml == pytest.approx(strips * shape.support_mm3 / 1000)
    for batch in batches:
        assert batch.mixed_ml >= 1.3 * batch.cavities_ml
        portions = batch.portions()
        assert sum(ml for _, ml, _ in portions) == pytest.approx(batch.mixed_ml)
        assert sum(g for _, _, g in portions) == pytest.approx(batch.mixed_g)
    (_, a_ml, _), (_, b_ml, _) = dyed.portions()
    assert b_ml == pytest.approx(2 * a_ml)  # as in the paper
    ml = {name: ml for name, ml, _ in support.portions()}
    assert ml["Dragon Skin 30 A"] == pytest.approx(2 * ml["Ecoflex 00-30 B"])  # as in the paper


@pytest.mark.parametrize("strips", [1, 30])
def test_the_bill_of_materials_has_all_that_the_recipe_consumes(strips):
    """Fails if the recipe consumes a component that nobody is told to buy, or enough of."""
    shape = StripShape(85)
    text = strip_recipe.text(shape, strips, 0.028, "spots design")
    table = csv.DictReader(io.StringIO(parts.csv_text(shape, strips)))
    counts = {row["part"]: row["count"] for row in table}
    named = {name for one in parts.parts() for name in one.of}
    used = strip_recipe.consumption_g(shape, strips)
    assert named == used.keys()
    for mass_g in used.values():
        assert f"{mass_g:.3g} g" in " ".join(counts.values())
    (b_g,) = re.findall(r"paste for polyurethane in ([\d.]+) g of part B", text)
    batches = strip_recipe.batches(shape, strips)
    mixed = [g for batch in batches for name, _, g in batch.portions() if name == "B"]
    assert used["B"] == pytest.approx(sum(mixed) + float(b_g))
    assert counts["AS7341 breakout"] == str(strips)
    assert all(one.euros or not one.counted for one in parts.parts())


@pytest.mark.board
def test_a_length_without_moulds_gets_the_other_files(tmp_path, capsys):
    assert written(tmp_path, 20) == 0
    assert "no moulds were made: moulds are for strips of 30 to 200 mm" in capsys.readouterr().err
    assert {path.name for path in tmp_path.iterdir()} == {"sensor.toml", "resolution.png"}


def test_a_missing_package_is_one_sentence_with_the_command(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(strip_mould, "find_spec", lambda name: None)
    assert written(tmp_path / "new", 85) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.count("\n") == 1
    assert '[moulds]"' in said.err
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (["--strips", "0"], "--strips must be from 1 to 100, not 0"),
        (["--breakout", "adafruit-4689"], "did you mean adafruit-4698?"),
        (["--measure-dye"], "leave out --out"),
        (["--port", "virtual"], "--port has no effect here: add --measure-dye"),
    ],
)
def test_a_mistake_is_one_sentence(tmp_path, capsys, options, says):
    try:
        code = written(tmp_path / "new", 85, *options)
    except SystemExit as exit:  # the parser's own refusal
        code = exit.code
    assert code == 2
    said = capsys.readouterr()
    assert says in said.err
    assert said.err.count("\n") == 1
    assert not (tmp_path / "new").exists()
