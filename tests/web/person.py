"""A person who calibrates a strip with what the web UI shows: text, marks and fields."""

from __future__ import annotations

import re
import time

import numpy as np

from spots_sim.scenario import Press

G_PER_N = 101.97  # what a scale shows for a newton
WIDTH_MM = 4.0
ANY_N = 5.0  # what a fingertip presses if the page asks for no force
LOOK = """() => {
  const at = (name) => document.querySelector("#calibration " + name);
  const seen = (one) => one && one.getClientRects().length > 0;
  const text = (name) => seen(at(name)) ? at(name).innerText : "";
  const box = (name) => at(name).getBoundingClientRect();
  const aim = box(".aim"), track = box(".track");
  return {
    todo: text(".todo"), note: text(".note.warn"), trouble: text(".hold span:last-child"),
    count: text(".head b"), said: text(".said"), asks: seen(at(".answer .main")),
    fields: [...document.querySelectorAll("#calibration .answer .field")].map((f) => f.innerText),
    share: seen(at(".aim")) ? (aim.left + aim.width / 2 - track.left) / track.width : null,
    starts: seen(at(".begin")),
  };
}"""


class Person:
    """Presses where the web UI asks for it, and answers its questions.

    Parameters
    ----------
    page : playwright.sync_api.Page
        The page, of a browser with the token.
    held : spots_sim.scenario.Held
        The finger.
    length_mm : float
        Length of the strip.
    place_mm, force_share : float
        Errors of a press: a place within so many mm, a force within this share.
    in_newtons : callable
        Whether the person types the next force in newtons instead of grams.
    """

    def __init__(self, page, held, length_mm, seed=0, place_mm=0.0, force_share=0.0):
        self.page, self._held, self._length_mm = page, held, length_mm
        self._random = np.random.default_rng(seed)
        self._place_mm, self._force_share = place_mm, force_share
        self.presses = self.answers = 0
        self.seen = []
        self._request = None

    def look(self):
        """Return what the page shows."""
        return self.page.evaluate(LOOK)

    def start(self, kind):
        """Press the button of a kind of session."""
        self.page.locator(f"#calibration .kind[value={kind}]").click()

    def go_on(self, until=lambda seen: seen["starts"], timeout_s=300.0):
        """Do what the page asks for until `until(seen)`; return what was seen last."""
        end_s = time.monotonic() + timeout_s
        while not until(seen := self.look()):
            assert time.monotonic() < end_s, seen
            self.act(seen)
            self.page.wait_for_timeout(30)
        return seen

    def act(self, seen):
        """Do once what the page asks for."""
        request = seen["todo"], seen["share"], seen["count"]
        if request == self._request and not seen["asks"]:
            return
        self._request = request
        if seen["asks"]:
            self.answer(seen)
        elif seen["todo"].lower().startswith("press"):
            self.press(seen)
        elif seen["todo"].lower().startswith("release"):
            self._held.press = None

    def press(self, seen):
        """Press where the mark is drawn on the strip, with the force in the text."""
        off_mm = self._random.uniform(-self._place_mm, self._place_mm)
        self.place_mm = min(max(seen["share"] * self._length_mm + off_mm, 0), self._length_mm)
        found = re.search(r"([\d.]+) (N|g)\b", seen["todo"])
        force_N = ANY_N if found is None else float(found[1]) / {"N": 1, "g": G_PER_N}[found[2]]
        self.force_N = force_N * (1 + self._random.uniform(-self._force_share, self._force_share))
        self._held.press = Press(self.place_mm, 1000 * self.force_N, WIDTH_MM)
        self.presses += 1

    def answer(self, seen):
        """Accept the usual answer."""
        self.page.locator("#calibration .answer .main").click()
        self.answers += 1
