"""A simulated person who calibrates a strip with what the web UI shows: text, marks and fields."""

from __future__ import annotations

import re
import time

import numpy as np

from spots_sim.strip.scenario import Press
from support.serving import until

G_PER_N = 101.97  # grams that a scale shows for a force of 1 N
WIDTH_MM = 4.0
LOOK_EVERY_S = 0.05
FIRM_N = 3.0, 8.0  # range of the person's forces if the page names no force
LOOK = """() => {
  const at = (name) => document.querySelector("#calibration " + name);
  const seen = (one) => Boolean(one) && one.getClientRects().length > 0;
  const text = (name) => seen(at(name)) ? at(name).innerText : "";
  const box = (name) => at(name).getBoundingClientRect();
  const aim = box(".aim"), track = box(".along"), glow = box(".finger");
  const share = (one) => (one.left + one.width / 2 - track.left) / track.width;
  return {
    todo: text(".todo"), note: text(".note.warn"), trouble: text(".hold span:last-child"),
    count: text(".head b"), said: text(".said"), asks: seen(at(".answer .main")),
    share: seen(at(".aim")) ? share(aim) : null,
    finger: at(".finger").classList.contains("on") ? share(glow) : null,
    steady: Number(at("[role=meter]").ariaValueNow),
    starts: seen(at(".begin")), may_stop: seen(at(".buttons")),
  };
}"""


def look(page):
    """Return the state of the calibration that the page shows, a dict with the names in `LOOK`."""
    return page.evaluate(LOOK)


class Person:
    """Presses where the web UI asks for it, and answers its questions.

    Parameters
    ----------
    page : playwright.sync_api.Page
        The web UI in a browser that has the access token.
    held : spots_sim.strip.scenario.Held
        The simulated finger.
    length_mm : float
        Length of the strip in mm.
    place_mm, force_share : float
        Largest error of a press: of its position in mm, and of its force as a share of the force.

    Attributes
    ----------
    now_s : callable
        Clock of the timeouts, in s. With the clock of a simulated board, the timeouts do not depend
        on the load of the machine.
    looked : callable
        Called after each look at the page.
    """

    now_s = staticmethod(time.monotonic)
    looked = staticmethod(lambda: None)

    def __init__(self, page, held, length_mm, seed=0, place_mm=0.0, force_share=0.0):
        self.page = page
        self._held, self._length_mm = held, length_mm
        self._random = np.random.default_rng(seed)
        self._place_mm, self._force_share = place_mm, force_share
        self.presses = self.answers = 0
        self._last = None

    def start(self, kind):
        """Press the button of a kind of session, and wait until the session runs."""
        until(self.page, "drawn.length > 0")  # a request without a board would be refused
        self.page.locator(f"#calibration .kind[value={kind}]").click()
        self.wait(lambda seen: not seen["starts"])

    def go_on(self, until=lambda seen: seen["starts"], timeout_s=120.0):
        """Do what the page asks for, until `until(seen)` is true; see `wait`."""
        return self.wait(until, self.act, timeout_s)

    def wait(self, until, act=lambda seen: None, timeout_s=60.0):
        """Watch the page until `until(seen)` is true; return the last result of `look`.

        Parameters
        ----------
        until : callable
            ``until(seen) -> bool``; `seen` is a result of `look`.
        act : callable
            ``act(seen)`` is called after each look before `until` is true.
        timeout_s : float
            Longest wait in s; after it, the test fails.
        """
        end_s = self.now_s() + timeout_s
        while not until(seen := look(self.page)):
            assert self.now_s() < end_s, seen
            act(seen)
            self.looked()
            time.sleep(LOOK_EVERY_S)
        return seen

    def act(self, seen):
        """Do what the page asks for, unless this was done already at an earlier look."""
        asked = seen["todo"], seen["share"], seen["count"], seen["asks"]
        if asked == self._last:
            return
        self._last = asked
        if seen["asks"]:
            self.answer(seen)
        elif seen["todo"].startswith("Press"):
            self.press(seen)
        elif seen["todo"].startswith("Release"):
            self._held.press = None

    def press(self, seen):
        """Press where the mark is drawn on the strip, with the force in the text."""
        off_mm = self._random.uniform(-self._place_mm, self._place_mm)
        place_mm = seen["share"] * self._length_mm + off_mm
        found = re.search(r"([\d.]+) (N|g)\b", seen["todo"])
        if found is None:
            force_N = self._random.uniform(*FIRM_N)
        else:
            force_N = float(found[1]) / {"N": 1, "g": G_PER_N}[found[2]]
            force_N *= 1 + self._random.uniform(-self._force_share, self._force_share)
        self.force_N, self.presses = force_N, self.presses + 1
        self._held.press = Press(min(max(place_mm, 0), self._length_mm), 1000 * force_N, WIDTH_MM)

    def lift(self):
        """Lift the finger."""
        self._held.press = None

    def answer(self, seen):
        """Confirm the position. Type the force that the scale shows, if the page asks for it."""
        form = self.page.locator("#calibration .answer")
        if form.get_by_label("Force").count():
            unit, value = ("N", self.force_N) if self.answers % 2 else ("g", self.force_N * G_PER_N)
            form.get_by_label("Force", exact=True).fill(f"{value:.4g}{unit}")
        form.locator(".main").click()
        self.answers += 1
