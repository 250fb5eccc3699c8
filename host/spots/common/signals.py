"""Releases all keys and buttons of open outputs before a signal ends or stops the process.

An output (a keyboard or gamepad of this computer) is open inside its own ``with`` block. It applies
each change inside a second block, ``with SECTION``. A signal during the second block is deferred to
the end of this block, so each change is completed. After the process was suspended (as by Ctrl-Z),
outputs ignore presses until the program calls `resumed`.

SIGKILL, SIGSTOP and a crash in C cannot be handled.
"""

import _thread
import contextlib
import signal
import sys
import threading
import time
import weakref
from collections.abc import Callable, Iterator

from ..errors import SpotsError, printable

# Console events of Windows. Windows ends the process when their handler returns, or after 5 s.
_CONSOLE_EVENTS = (2, 5, 6)  # close, logoff, shutdown
_CONSOLE_S = 4.5
_END_S = 2.0  # time after a signal in which `ended_cleanly` ignores further ones


def numbers(*names: str) -> list[int]:
    """Return the numbers of the signals `names` that this operating system has."""
    return [getattr(signal, name) for name in names if hasattr(signal, name)]


# Signals that end, stop and continue a process. Each system has some of them.
_ENDING = numbers("SIGINT", "SIGTERM", "SIGHUP", "SIGQUIT", "SIGABRT", "SIGBREAK")
_STOPPING = numbers("SIGTSTP", "SIGTTIN", "SIGTTOU")
# SIGSTOP cannot be handled: outputs release their keys when the process continues.
_CONTINUING = numbers("SIGCONT")


class _Section:
    """Defers signals while the main thread is in a block ``with SECTION``; blocks can be nested.

    `outputs` are the open `outputs.Output`. `ended_by` is the number of the signal that ends the
    process; None before. `around` has what to call before a stop signal takes effect and when the
    process continues.
    """

    def __init__(self):
        self.outputs = weakref.WeakSet()
        self.around: list[tuple[Callable[[], None], Callable[[], None]]] = []
        self.ended_by: int | None = None
        self._depth = 0
        self._pending: list[int] = []
        self._stopped = False

    def __enter__(self) -> None:
        self._depth += 1

    def __exit__(self, *exception) -> None:
        self._depth -= 1
        self._act()

    def handle(self, number: int, frame=None) -> None:
        """Signal handler: act on the signal `number` now, or at the end of ``with SECTION``."""
        if self.ended_by is not None:
            return  # the process is ending: a SIGCONT now must not raise a second exception
        if number not in self._pending:
            self._pending.append(number)
        self._act()

    def resumed(self) -> bool:
        """Return whether the process was suspended (as by Ctrl-Z) since the last call.

        If it was, the open outputs accept presses again.
        """
        if not self._stopped:
            return False
        self._stopped = False
        for output in list(self.outputs):
            output.muted = False
        return True

    def _act(self) -> None:
        # A signal may interrupt this function between any two lines: its handler then takes all
        # pending signals, or leaves them to this call.
        while self._pending and not self._depth:
            self._depth += 1
            try:
                while self._pending:
                    self._take_effect(self._pending.pop(0))
            finally:
                self._depth -= 1

    def _take_effect(self, number: int) -> None:
        # An output that prints may raise SIGTTOU again and again.
        ignored = self._ignore(_STOPPING)
        for output in list(self.outputs):
            with contextlib.suppress(SpotsError, OSError):  # its device or terminal has disappeared
                output.mute()
        for one in ignored:
            signal.signal(one, self.handle)
        if number in _ENDING:
            self.ended_by = number
            self._ignore(_ENDING)  # a second signal must not disturb the end
            self._pending.clear()
            raise KeyboardInterrupt if number == signal.SIGINT else SystemExit(128 + number)
        self._stopped = True
        if number in _STOPPING:
            for leave, _ in self.around:
                leave()
            signal.signal(number, signal.SIG_DFL)
            signal.raise_signal(number)  # returns when the process continues
            signal.signal(number, self.handle)
            for _, enter in self.around:
                enter()

    def _ignore(self, numbers: list[int]) -> list[int]:
        """Ignore those of the signals `numbers` that this section handles, and return them."""
        handled = [one for one in numbers if signal.getsignal(one) == self.handle]
        for one in handled:
            signal.signal(one, signal.SIG_IGN)
        return handled


SECTION = _Section()
resumed = SECTION.resumed


@contextlib.contextmanager
def around_stops(leave: Callable[[], None], enter: Callable[[], None]) -> Iterator[None]:
    """Run a block in which a stop signal (Ctrl-Z) calls ``leave()``, and ``enter()`` afterwards.

    In another thread than the main thread, they are called only if the main thread handles the
    signals.

    Parameters
    ----------
    leave, enter : callable
        Called in a signal handler: they must not use buffered files.

    Yields
    ------
    None
    """
    handled: list[int] = []
    if threading.current_thread() is threading.main_thread():
        handled = [one for one in _STOPPING if signal.getsignal(one) == signal.SIG_DFL]
    for one in handled:
        signal.signal(one, SECTION.handle)
    SECTION.around.append(pair := (leave, enter))
    try:
        yield
    finally:
        SECTION.around.remove(pair)
        for one in handled:
            signal.signal(one, signal.SIG_DFL)


@contextlib.contextmanager
def released_by_signals() -> Iterator[None]:
    """Run a block in which a signal first releases all open outputs, and then takes effect.

    A signal that ends the process raises KeyboardInterrupt or SystemExit in the block. After the
    block the process ends by that signal, unless the block caught the exception. A stop signal
    (Ctrl-Z) stops the process inside the block. Ignored signals stay ignored (nohup). Call this in
    the main thread only, because Python delivers signals there.
    """
    # Ignored signals stay ignored. A handler that C code has set (None) could not be restored.
    numbers = _ENDING + _STOPPING + _CONTINUING
    numbers = [one for one in numbers if signal.getsignal(one) not in (signal.SIG_IGN, None)]
    before = {number: signal.signal(number, SECTION.handle) for number in numbers}
    ended_by = None
    released = threading.Event()
    try:
        with _console_events(released):
            yield
    except (KeyboardInterrupt, SystemExit):
        ended_by = SECTION.ended_by
        if ended_by is None or sys.platform == "win32":
            raise
    finally:
        released.set()
        SECTION.ended_by = None
        resumed()
        if ended_by is not None:
            _end_by(ended_by)
        for number, handler in before.items():
            signal.signal(number, handler)


def _end_by(number: int) -> None:
    with contextlib.suppress(OSError):
        sys.stdout.flush()
    signal.signal(number, signal.SIG_DFL)
    signal.raise_signal(number)


@contextlib.contextmanager
def ended_cleanly() -> Iterator[None]:
    """Run a block which SIGTERM and SIGHUP end by SystemExit, so that its files are completed.

    Without this block, these signals end the process at once: ``systemctl stop`` and a closed
    terminal would leave a recording without its end mark. After the block, the process ends by the
    signal. In another thread than the main thread, do nothing: Python delivers signals only there.

    Yields
    ------
    None
    """
    handled: list[int] = []
    if threading.current_thread() is threading.main_thread():
        # Signals with another handler, or ignored signals (nohup), are not changed.
        known = numbers("SIGTERM", "SIGHUP", "SIGBREAK")
        handled = [one for one in known if signal.getsignal(one) == signal.SIG_DFL]
    ended: list[tuple[int, float]] = []

    def end(number: int, frame: object) -> None:
        # A second signal at the same time (a service manager may send both) must not disturb the
        # end. A later one must have an effect: Python ignores an exception of a signal handler that
        # interrupts a finalizer.
        now_s = time.monotonic()
        if not ended or now_s >= ended[-1][1] + _END_S:
            ended.append((number, now_s))
            raise SystemExit(128 + number)

    for one in handled:
        signal.signal(one, end)
    try:
        yield
    finally:
        for one in handled:
            signal.signal(one, signal.SIG_DFL)
        if ended and sys.platform != "win32":
            _end_by(ended[-1][0])


@contextlib.contextmanager
def _console_events(released: threading.Event) -> Iterator[None]:
    if sys.platform != "win32":
        yield
        return
    import ctypes
    from ctypes import wintypes

    kernel32 = ctypes.WinDLL("kernel32", use_last_error=True)
    handler_type = ctypes.WINFUNCTYPE(wintypes.BOOL, wintypes.DWORD)
    handler = handler_type(lambda event: on_console_event(event, released))
    kernel32.SetConsoleCtrlHandler(handler, True)
    try:
        yield
    finally:
        kernel32.SetConsoleCtrlHandler(handler, False)


def on_console_event(event: int, released: threading.Event) -> bool:
    """Handle a console event of Windows; on close, logoff and shutdown, release all outputs.

    Interrupt the main thread as Ctrl-C does, and wait until that thread has released all outputs,
    at most 4.5 s. Windows calls this function in another thread.

    Parameters
    ----------
    event : int
        ``dwCtrlType`` of the console control handler.
    released : threading.Event
        Set when the main thread has released all outputs.

    Returns
    -------
    bool
        True for close, logoff and shutdown. False for other events; Windows then calls the next
        handler.
    """
    if event not in _CONSOLE_EVENTS:
        return False
    _thread.interrupt_main()
    released.wait(_CONSOLE_S)
    return True


@contextlib.contextmanager
def stop_explained(state: Callable[[], str]) -> Iterator[None]:
    """Run a block in which Ctrl-C prints a sentence about what is stored and how to go on.

    Parameters
    ----------
    state : callable
        Returns the sentence. It is called after Ctrl-C; KeyboardInterrupt is then raised again.

    Yields
    ------
    None
    """
    try:
        yield
    except KeyboardInterrupt:
        print(f"\nspots: stopped: {printable(state())}", file=sys.stderr)
        raise
