"""For all tests."""

import os
import signal
import threading

from hypothesis import settings
from threadpoolctl import threadpool_limits

# Tests run side by side; threads of linear algebra would spin, and take four times the time. What other processes and
# SciPy load reads the environment; NumPy has been loaded by now, by plugins of pytest.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
threadpool_limits(int(os.environ["OPENBLAS_NUM_THREADS"]))

# No test is timed: a first example may import or compile.
settings.register_profile("flightcal", deadline=None)
settings.load_profile("flightcal")


def _keep_to_own_cores():
    """Tests run side by side on cores of their own: threads of two processes on the same two cores get in their way."""
    worker, count = os.environ.get("PYTEST_XDIST_WORKER"), int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1"))
    if worker is None or not hasattr(os, "sched_setaffinity"):
        return
    allowed = sorted(os.sched_getaffinity(0))
    if cores := allowed[int(worker.removeprefix("gw")) % count :: count]:
        os.sched_setaffinity(0, cores)


_keep_to_own_cores()


def pytest_configure():
    """Have interrupts arrive: a shell that starts the tests in the background has them ignored, children inherit it."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN and threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, signal.default_int_handler)
