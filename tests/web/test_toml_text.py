"""Any valid layout file is edited through the web UI; everything else in it stays byte for byte."""

import difflib
import json

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from spots.common import toml
from spots.controller import controller_settings
from spots.keyboard.layout import load
from spots_web.editors import LayoutEditor, SettingsEditor
from spots_web.state import PageState

DIGITS = load("digits")
CHARACTERS = st.sampled_from("ABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789")
COMMENT = st.sampled_from(
    ['# """', "# '''", '# a = "x', "# [layer]", "# ]", "#", "# ü # {", "# keys = [ '", "\t# x"]
)
LABEL = st.text(st.sampled_from("ab \"'\\#=[]{},.ü€😀"), max_size=6)
BARE = st.sampled_from(["{}", '"{}"', "'{}'", " {} ", '"{}"\t'])


def literals(value):
    """Notations of a string."""
    basic = json.dumps(value, ensure_ascii=False)
    found = [basic, json.dumps(value).replace("\\ud83d\\ude00", "\\U0001F600")]
    if '"""' not in basic:
        found.append(f'""{basic}""')
    if "'" not in value:
        found += [f"'{value}'", f"'''{value}'''"]
    return st.sampled_from(found)


class Writer:
    """Writes a file in random notation; the texts of single values can be replaced later."""

    def __init__(self, draw):
        self.draw, self.parts, self.places = draw, [], {}

    def put(self, text):
        self.parts.append(text)

    def pick(self, *choices):
        return self.draw(st.sampled_from(choices))

    def key(self, name):
        self.put(self.draw(BARE).format(name) + self.pick("=", " = ", " =\t"))

    def value(self, place, value):
        self.places[place] = len(self.parts)
        self.put(self.draw(literals(value)) if isinstance(value, str) else str(value))

    def space(self):
        """Space inside a list, perhaps with comments."""
        for _ in range(self.draw(st.integers(0, 2))):
            self.put(self.pick(" ", "\n", "\t", "\n  "))
            if self.draw(st.integers(0, 3)) == 0:
                self.put(self.draw(COMMENT) + "\n")

    def end(self):
        """End of a line, and comments and empty lines after it."""
        self.put(self.pick("", " ", "  " + self.draw(COMMENT)) + "\n")
        for _ in range(self.draw(st.integers(0, 1))):
            self.put(self.pick("", self.draw(COMMENT)) + "\n")

    def inline(self, place, table):
        self.put("{" + self.pick("", " "))
        for i, (name, value) in enumerate(table.items()):
            self.put(self.pick(",", ", ", " , ") if i else "")
            self.key(name)
            if name == "keys":
                self.keys((*place, name), value)
            else:
                self.value((*place, name), value)
        self.put(self.pick("", " ") + "}")

    def keys(self, place, keys):
        self.put("[")
        for i, key in enumerate(keys):
            self.space()
            if isinstance(key, str):
                self.value((*place, i), key)
            else:
                self.inline((*place, i), key)
            self.space()
            self.put("," if i + 1 < len(keys) else self.pick("", ","))
        self.space()
        self.put("]")

    def pairs(self, place, table, prefix=""):
        for name, value in table.items():
            self.put(prefix)
            self.key(name)
            if name == "keys":
                self.keys((*place, name), value)
            else:
                self.value((*place, name), value)
            self.end()

    def text(self, place=None, literal=None):
        parts = list(self.parts)
        if place is not None:
            parts[self.places[place]] = literal
        return "".join(parts)


@st.composite
def files(draw):
    """A random layout: its content, its writer, and its line ends."""
    actions = st.fixed_dictionaries(
        {"tap": CHARACTERS}, optional={"hold": CHARACTERS, "label": LABEL, "width": st.just(0.5)}
    )
    keys = st.lists(CHARACTERS | actions, min_size=1, max_size=4)
    layers = draw(st.lists(keys, min_size=1, max_size=3))
    names = ["one", "two", "three"][: len(layers)]
    layers = [{"name": name, "keys": keys} for name, keys in zip(names, layers)]
    layers[0]["keys"] += [f"toggle {name}" for name in names[1:]]
    for name, layer in zip(names[1:], layers[1:]):
        layer["keys"].append(f"toggle {name}")
    numbers = {"press_mN": st.just(401), "firm_mN": st.just(4001), "tapping_term_ms": st.just(251)}
    tuning = draw(st.fixed_dictionaries({}, optional=numbers))
    content = {"name": draw(LABEL), "layer": layers} | ({"tuning": tuning} if tuning else {})
    writer = Writer(draw)
    for _ in range(draw(st.integers(0, 2))):
        writer.end()
    writer.pairs((), {"name": content["name"]})
    how, last = draw(st.sampled_from(["table", "inline", "dotted"])), draw(st.booleans())
    if tuning and how == "inline":
        writer.key("tuning")
        writer.inline(("tuning",), tuning)
        writer.end()
    elif tuning and how == "dotted":
        writer.pairs(("tuning",), tuning, draw(st.sampled_from(["tuning.", "'tuning' . "])))

    def table():
        if tuning and how == "table":
            writer.put("[" + writer.pick("tuning", ' "tuning" ') + "]")
            writer.end()
            writer.pairs(("tuning",), tuning)

    if draw(st.booleans()):
        if not last:
            table()
        head, indent = writer.pick("[[layer]]", "  [[ 'layer' ]]"), writer.pick("", "  ")
        for i, layer in enumerate(layers):
            writer.put(head)
            writer.end()
            writer.pairs(("layer", i), layer, indent)
        if last:
            table()
    else:
        writer.key("layer")
        writer.put("[")
        for i, layer in enumerate(layers):
            writer.space()
            writer.inline(("layer", i), layer)
            writer.put(",")
        writer.space()
        writer.put("]")
        writer.end()
        table()
    crlf = draw(st.booleans())
    return content, writer, (lambda text: text.replace("\n", "\r\n") if crlf else text)


def editor(path, text):
    path.write_bytes(text.encode())
    return LayoutEditor(path, DIGITS, PageState())


def changed(one, content):
    """Return the answer to a check of a changed content, as a browser sends it."""
    body = json.dumps({"do": "check", "content": content}).encode()
    return one.submit(one.decode(body)).result(0)


def at(content, place):
    for name in place:
        content = content[name]
    return content


CHECKED = settings(
    max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)


@pytest.mark.board
@CHECKED
@given(files(), st.data())
def test_a_changed_value_changes_its_own_bytes_only(tmp_path, file, data):
    content, writer, form = file
    text = form(writer.text())
    assert toml.loads(text) == content
    one = editor(tmp_path / "mine.toml", text)
    now = json.loads(json.dumps(one._layout.content))
    assert changed(one, now)["text"] == text
    for place in data.draw(st.permutations(sorted(writer.places, key=str)))[:3]:
        was = at(content, place)
        value = {251: 252, 401: 402, 4001: 4002, 0.5: 0.25}.get(was, "Y" if was == "Z" else "Z")
        if str(was).startswith("toggle") or (place[0] == "layer" and place[-1] == "name"):
            continue
        now = json.loads(json.dumps(one._layout.content))
        at(now, place[:-1])[place[-1]] = value
        answer = changed(one, now)
        assert answer["text"] == form(writer.text(place, json.dumps(value)))
        assert answer["lost"] == 0


EDITS = ("add a zone", "remove a zone", "add an action", "add a layer", "tune", "untune", "swipe")


@pytest.mark.board
@CHECKED
@given(files(), st.lists(st.sampled_from(EDITS), min_size=1, max_size=4), st.randoms())
def test_zones_layers_and_tuning_come_and_go(tmp_path, file, edits, random):
    _, writer, form = file
    text = form(writer.text())
    one = editor(tmp_path / "mine.toml", text)
    now = json.loads(json.dumps(one._layout.content))
    removed = 0
    for edit in edits:
        layer = random.choice(now["layer"])
        keys = layer["keys"]
        i = random.randrange(len(keys))
        if edit == "add a zone":
            keys.insert(i, random.choice(["Q", {}, {"tap": "Q", "firm": "W"}]))
        elif (
            edit == "remove a zone"
            and not str(keys[i]).startswith(("toggle", "momentary"))
            and len(keys) > 1
        ):
            keys.pop(i)
            removed += 1
        elif edit == "add an action" and isinstance(keys[i], dict):
            keys[i]["double"] = "F5"
        elif edit == "add a layer" and len(now["layer"]) < 4 and "more" not in str(now):
            now["layer"][0]["keys"].append("momentary more")
            now["layer"].append({"name": "more", "keys": [{}, {"tap": "A", "hold": "B"}]})
        elif edit == "tune":
            now.setdefault("tuning", {})["slide_um"] = 4321
        elif edit == "untune":
            removed += bool(now.pop("tuning", None))
        elif edit == "swipe":
            layer["swipe_plus"] = "F6"
    answer = changed(one, now)
    assert answer["content"] == now
    made = answer["text"]
    assert ("\r\n" in made) == ("\r\n" in text)
    assert made.count("\r\n") in (0, made.count("\n"))
    if not removed:
        assert answer["lost"] == 0
    if not removed and len(edits) == 1:
        # Lines that nothing was changed in are still there, in their order.
        lines = difflib.ndiff(text.splitlines(), made.splitlines())
        gone = [line for line in lines if line.startswith("- ")]
        assert len(gone) <= 2, gone


def test_a_file_that_cannot_be_patched_is_written_again(tmp_path, monkeypatch):
    text = '# mine\nname = "a"\n[[layer]]\nname = "b"\nkeys = ["A"]\n'
    one = editor(tmp_path / "mine.toml", text)
    now = json.loads(json.dumps(one._layout.content))
    now["layer"][0]["keys"] = ["B", {"tap": "C", "hold": "D"}]
    monkeypatch.setattr("spots_web.toml_text._array", lambda text, was, now: text)
    answer = changed(one, now)
    assert (answer["content"], answer["lost"]) == (now, 1)


def test_comments_stay_with_their_entries(tmp_path):
    rows = ['  "A",  # a', '  "B",  # b', '  {tap = "C", hold = "D"},  # c']
    text = "\n".join(['name = "x"', "[[layer]]", 'name = "y"', "keys = [", *rows, "]", ""])
    one = editor(tmp_path / "mine.toml", text)
    now = json.loads(json.dumps(one._layout.content))
    now["layer"][0]["keys"] = ["A", {"tap": "C", "hold": "D"}, "E"]
    lines = changed(one, now)["text"].splitlines()
    assert [line for line in lines if "#" in line] == [rows[0], rows[2]]
    now["layer"][0]["keys"] = ["B", "B", {"tap": "C", "hold": "E"}]
    lines = changed(one, now)["text"].splitlines()[4:7]
    assert lines == [rows[0].replace('"A"', '"B"'), rows[1], rows[2].replace('"D"', '"E"')]


SETTINGS = controller_settings.DEFAULT.read_text(encoding="utf-8")


@pytest.mark.parametrize("newline", ["\n", "\r\n"])
def test_settings_are_changed_in_every_notation(tmp_path, newline):
    lines = [
        'hold_ms = 90 # """',
        'x = { from = "position", "expo" = 0.5, smooth.beta = 3 } # x',
        "y.from = 'force' # '''",
        'y."max_mN" = 4_000  # 4 N',
        "button = [ # all",
        '  { number = 1, when = "tapped" }, # first',
        '  { number = 2, when = "pressed", press_mN = 2e3 },',
        "]",
        "",
    ]
    path = tmp_path / "c.toml"
    path.write_bytes(newline.join(lines).encode())
    one = SettingsEditor("controller", path, PageState())
    content = one._state.since(one._state.begin())[1]["controller"]["content"]
    now = json.loads(json.dumps(content))
    now["hold_ms"] = 80
    now["x"]["smooth"]["beta"] = 4.5
    now["y"]["max_mN"] = 5000
    now["button"][0]["pulse_ms"] = 20
    now["button"][1]["press_mN"] = 2500
    text = changed(one, now)["text"]
    wanted = list(lines)
    for at, was, to in (
        (0, "90", "80"),
        (1, "beta = 3", "beta = 4.5"),
        (3, "4_000", "5000"),
        (5, '"tapped" }', '"tapped" , pulse_ms = 20}'),
        (6, "2e3", "2500"),
    ):
        wanted[at] = wanted[at].replace(was, to)
    assert text.split(newline)[:5] == wanted[:5]
    assert text.split(newline)[6:] == wanted[6:]
    assert text.split(newline)[5].replace(" ", "") == wanted[5].replace(" ", "")
