"""Random layouts with all behaviours, and random fingers on them."""

from pathlib import Path

from spots.keyboard.key_layout import FLAVORS
from spots.keyboard.layout import compiled
from spots_sim.strip.files import Finger

_KEYS = [
    *"ABCDEFGHIJKLMNOPQRSTUVWXYZ1234567890", "ENTER", "SPACEBAR", "BACKSPACE", "TAB",
    "LEFT_SHIFT+A", "LEFT_SHIFT+1", "LEFT_CONTROL+C", "LEFT_ALT+TAB", "LEFT_SHIFT", "LEFT_CONTROL",
    "LEFT_ALT+LEFT_SHIFT", "VOLUME_INCREMENT", "PLAY_PAUSE", "key_repeat", "caps_word",
    "sticky LEFT_SHIFT", "sticky RIGHT_ALT", "tap_dance d", "mod_morph m",
]  # fmt: skip
_MORE = """
[tap_dance.d]
actions = ["A", "LEFT_SHIFT+B", "sticky LEFT_CONTROL"]
holds = ["LEFT_ALT", "", "C"]
[mod_morph.m]
action = "A"
morphed = "B"
mods = ["LEFT_SHIFT"]
"""


def random_layout(rng):
    """Return a random `KeyLayout` with one to three layers of five to ten keys."""
    names = ["one", "two", "three"][: int(rng.integers(1, 4))]
    text = 'name = "random"\n[tuning]\n'
    text += f"tapping_term_ms = {rng.integers(60, 400)}\nquick_tap_ms = {rng.integers(0, 300)}\n"
    text += f"firm_ms = {rng.integers(20, 200)}\nrelease_after_ms = {rng.choice([0, 500])}\n"
    text += f'require_prior_idle_ms = {rng.choice([0, 100])}\nflavor = "{rng.choice(FLAVORS)}"\n'
    for name in names:
        actions = list(_KEYS)
        for other in names[1:]:
            actions += [f"{verb} {other}" for verb in ("momentary", "toggle", "sticky", "to")] * 2
        keys = []
        for _ in range(int(rng.integers(4, 10))):
            slots = [slot for slot in ("double", "hold", "firm") if rng.random() < 0.2]
            slots += ["slide_minus", "slide_plus"] * bool(rng.random() < 0.05)
            parts = [f'{slot} = "{rng.choice(actions)}"' for slot in ["tap", *slots]]
            if "hold" in slots and rng.random() < 0.2:
                parts.append("retro_tap = true")
            keys.append("{" + ", ".join(parts) + "}")
        ways = [f'"to {other}"' for other in names if other != name]
        text += f'[[layer]]\nname = "{name}"\nkeys = [{", ".join(keys + ways)}]\n'
        if rng.random() < 0.2:
            text += 'swipe_plus = "F1"\n'
    return compiled(Path("random"), text + _MORE)


def random_fingers(rng, start_s, end_s, length_mm):
    """Return fingers that roll, rest, press firmly and slide, at most two at the same time."""
    fingers, free_s = [], [start_s, start_s]
    now_s = start_s
    while True:
        now_s += float(rng.choice([0.02, 0.06, 0.12, 0.3, 1.0], p=[0.1, 0.3, 0.3, 0.25, 0.05]))
        now_s += float(rng.uniform(0, 0.02))
        hand = 0 if free_s[0] <= free_s[1] else 1
        now_s = max(now_s, free_s[hand] + 0.03)
        held_s = float(rng.choice([0.04, 0.08, 0.12, 0.3, 0.8], p=[0.1, 0.3, 0.35, 0.15, 0.1]))
        if now_s + held_s + 0.05 > end_s:
            return fingers
        x_mm = float(rng.uniform(0, length_mm))
        others = [one for one in fingers[-4:] if one.points[-1][0] > now_s]
        if any(abs(one.points[0][1] - x_mm) < 9 for one in others):
            continue
        to_mm = float(rng.uniform(0, length_mm)) if rng.random() < 0.05 and not others else x_mm
        force = float(rng.choice([1200, 2000, 6000], p=[0.4, 0.5, 0.1]))
        times = (now_s, now_s + 0.015, now_s + held_s, now_s + held_s + 0.015)
        points = zip(times, (x_mm, x_mm, to_mm, to_mm), (0.0, force, force, 0.0))
        fingers.append(Finger(points=list(points)))
        free_s[hand] = times[-1]
