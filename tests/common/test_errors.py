"""The tree of errors: classes and codes for programs, sentences for people.

All sentences in the sources are read here, so that other tests can assert class, code and place.
"""

import ast
import re
from pathlib import Path

import pytest

from spots import errors
from spots.errors import BoardError, FileError, SpotsError
from spots.link.board_errors import REASONS, reason_of

HOST = Path(__file__).parents[2] / "host"
# Words of a private dialect, with the field's own words.
HOUSE_WORDS = {
    "tell": "report, print, show",
    "tells": "reports, prints, shows",
    "told": "reported, printed, shown",
    "none of": "not",
    "take note": "record, mark",
    "is away": "disconnected, unplugged",
    "gone": "disconnected, unplugged",
    "silence": "timeout",
    "patience": "timeout",
    "let go": "release, close",
    "anew": "again",
    "of ours": "of SPOTS",
}
# Most lines of tests that compare an error with a sentence, because a table of faults of one class
# is told apart by nothing else. All other tests use `support.refusals.refusal`.
SENTENCES_MAX = 60
# What else brings a sentence, or the rest of one, to a person: classes whose text is put into an
# error of the tree, and functions that raise one. Strings without a space are no sentences.
BRINGING = {
    "ArgumentTypeError",
    "ValidationError",
    "ValueError",
    "WrongKeyError",
    "WrongTomlError",
    "_refuse",
    "error",
    "refuse",
}
PLACEHOLDER = "\N{HORIZONTAL ELLIPSIS}"
# A remedy follows a colon or semicolon, or the sentence states what is valid.
REMEDY = re.compile(r"[:;] |\b(must|needs?|can be|is an array|are for)\b")
# Sentences to which their callers add the remedy, and one about an answer of the user.
PARTS = {
    "'…' is not valid",
    "… is beyond the end of the strip at … mm",
    "…, because the answer was not 'y' or 'yes'",
    "the drive … …",
    "the board on … …",
    "the press at … mm is …",
    "the layout '…' has no key for '…'",
    "… now has board … instead of …",
    "no readings arrive",
}


def classes(root=SpotsError):
    """Yield the classes of the tree in `spots.errors`."""
    yield root
    for one in root.__subclasses__():
        if one.__module__ == errors.__name__:
            yield from classes(one)


NAMES = {one.__name__ for one in classes()}


def text_of(node):
    """Return the text of a constant or f-string, with `PLACEHOLDER` for each value in it."""
    if isinstance(node, ast.Constant):
        return str(node.value)
    if isinstance(node, ast.JoinedStr):
        return "".join(map(text_of, node.values))
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        return text_of(node.left) + text_of(node.right)
    return PLACEHOLDER


@pytest.fixture(scope="module")
def raised():
    """List of all calls of a class of the tree: (place, node)."""
    return [
        (f"{path.relative_to(HOST)}:{node.lineno}", node)
        for path in sorted(HOST.rglob("*.py"))
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in NAMES
    ]


@pytest.fixture(scope="module")
def sentences(raised):
    """Dict of the sentences in the sources, by place; sentences in a variable are left out."""
    found = {place: text_of(node.args[0]) for place, node in raised if node.args}
    return {place: text for place, text in found.items() if text != PLACEHOLDER}


@pytest.fixture(scope="module")
def spoken(raised, sentences):
    """Dict of the `sentences`, and of those that reach an error by another way, by place.

    These are arguments of what is `BRINGING`, and results of functions and values of variables
    that an error is called with.
    """
    found, heads = dict(sentences), [node.args[0] for _, node in raised if node.args]
    heads = [one.func if isinstance(one, ast.Call) else one for one in heads]
    names = {name_of(one) for one in heads} - {None, "str"}
    for path in sorted(HOST.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            texts = []
            if isinstance(node, ast.Call) and name_of(node.func) in BRINGING:
                texts = [text_of(one) for one in node.args]
            elif isinstance(node, ast.FunctionDef) and node.name in names:
                inside = (
                    one for one in ast.walk(node) if isinstance(one, ast.Return) and one.value
                )
                texts = [text_of(one.value) for one in inside]
            elif isinstance(node, ast.Assign) and name_of(node.targets[0]) in names:
                texts = [text_of(node.value)]
            for i, text in enumerate(texts):
                if " " in text.replace(PLACEHOLDER, ""):
                    found[f"{path.relative_to(HOST)}:{node.lineno}.{i}"] = text
    return found


def name_of(node):
    return getattr(node, "id", getattr(node, "attr", None))


def test_the_docstring_shows_the_whole_tree():
    for one in classes():
        # The depth is that of the class below SpotsError; each step has four characters.
        depth = one.__mro__.index(SpotsError) * 4
        line = rf"(?m)^    .{{{depth}}}{one.__name__}( |$)"
        assert re.search(line, errors.__doc__), one.__name__


@pytest.mark.board
def test_no_place_raises_the_root_class(raised):
    assert not [place for place, node in raised if node.func.id == "SpotsError"]


def test_all_sentences_are_found(raised, sentences):
    assert len(raised) > 350
    assert len(sentences) > 0.9 * len(raised)


@pytest.mark.board
def test_sentences_that_reach_an_error_by_another_way_are_found(sentences, spoken):
    others = {text for place, text in spoken.items() if place not in sentences}
    assert len(others) > 100
    # By a helper, by a constant, by a struct of a file, and by an option.
    for text in (
        "the board on … was disconnected",
        "must ascend: sort",
        "unknown key '…'",
        "is not a finite number",
        "there is no option …",
        "a session is running already",
    ):
        assert any(text in one for one in others), text


def test_a_message_is_one_line_without_a_period_at_its_end(spoken):
    for place, text in spoken.items():
        assert text == text.strip(), place
        assert "\n" not in text, place
        assert "  " not in text, place
        assert not text.endswith((".", "!")), place
        assert ". " not in text.replace("docs/", ""), place
        assert len(text) < 330, place


def test_a_message_says_what_to_do_or_what_is_valid(sentences):
    found = {text for text in sentences.values() if not REMEDY.search(text)}
    assert found == PARTS


def test_no_message_has_a_house_word(spoken):
    pattern = re.compile(rf"\b({'|'.join(HOUSE_WORDS)})\b")
    found = {place: pattern.findall(text) for place, text in spoken.items()}
    assert not {place: words for place, words in found.items() if words}


def test_each_refusal_of_a_board_has_a_code_of_the_table(raised):
    for place, node in raised:
        if node.func.id == "BoardError":
            assert len(node.args) == 2, place
            if isinstance(node.args[1], ast.Constant):
                assert node.args[1].value in REASONS, place


def test_a_code_that_the_program_does_not_know_is_none():
    assert reason_of({"error": "x", "why": "busy"}) == "busy"
    for unknown in ({}, {"why": "x"}, {"why": 5}, {"why": ["busy"]}, {"why": None}):
        assert reason_of(unknown) == ""


def test_an_error_of_a_file_has_its_path_and_place():
    error = FileError("no such key", Path("my.toml"), "layer.key")
    assert (str(error), error.path, error.place) == ("no such key", "my.toml", "layer.key")
    assert (FileError("x").path, FileError("x").place) == ("", "")


def test_an_error_of_a_board_has_a_code():
    assert BoardError("still runs", "busy").why == "busy"
    assert BoardError("still runs").why == ""


def test_tests_assert_the_class_and_the_code_of_an_error():
    tests = Path(__file__).parents[1]
    lines = [line for path in tests.rglob("*.py") for line in path.read_text("utf-8").split("\n")]
    assert 30 < sum(bool(re.search(r"\bmatch=", line)) for line in lines) <= SENTENCES_MAX
