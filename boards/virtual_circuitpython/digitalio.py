"""`digitalio` of the virtual board. A button that is held pulls every input low."""

import os


class Pull:
    UP = "up"
    DOWN = "down"


class DigitalInOut:
    def __init__(self, pin):
        self.value = False

    def deinit(self):
        pass

    def __enter__(self):
        return self

    def __exit__(self, *exception):
        self.deinit()

    def switch_to_input(self, pull=None):
        self.value = pull == Pull.UP and os.getenv("SPOTS_BUTTON") != "held"
