"""For all tests."""

import signal
import threading


def pytest_configure():
    """Have interrupts arrive: a shell that starts the tests in the background has them ignored, children inherit it."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN and threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, signal.default_int_handler)
