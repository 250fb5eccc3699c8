"""`watchdog` of the virtual board."""


class WatchDogMode:
    RAISE = object()
    RESET = object()
