"""For all tests."""

import os
import signal
import threading

from hypothesis import settings

# Tests run side by side; threads of linear algebra, which NumPy starts when it is imported, would spin.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# No test is timed: a first example may import or compile.
settings.register_profile("flightcal", deadline=None)
settings.load_profile("flightcal")


def pytest_configure():
    """Have interrupts arrive: a shell that starts the tests in the background has them ignored, children inherit it."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN and threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, signal.default_int_handler)
