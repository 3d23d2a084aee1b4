"""`each`: what it does for every item, whatever becomes of a process."""

import multiprocessing
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from flightcal.errors import RunError
from flightcal.run.workers import each

LOST = -1


def square(number):
    return number * number


def fail_at_three(number):
    if number == 3:
        raise FileNotFoundError(2, "no such thing", "name")
    return number


def die_at_two(number):
    if number == 2:
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def die_late_at_one(number):
    if number == 1:
        time.sleep(1.0)
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def pid(_):
    return os.getpid()


class Unreadable:
    """Kills each process that takes it."""

    __module__ = __name__

    def __reduce__(self):
        return os._exit, (1,)

    def __call__(self, item):
        return item


def results(task, items, workers=2):
    found = {}
    each(task, items, workers, done=found.__setitem__, lost=lambda _: LOST)
    return found


def test_every_item_has_its_result_and_no_process_is_left():
    assert results(square, range(40), 3) == {number: number * number for number in range(40)}
    assert not multiprocessing.active_children()


def test_no_more_processes_than_items_and_none_for_nothing():
    assert len(set(results(pid, range(2), 8).values())) <= 2
    assert results(square, [], 8) == {}


def test_an_item_that_kills_its_process_each_time_is_lost_and_no_other():
    assert results(die_at_two, range(6)) == {0: 0, 1: 1, 2: LOST, 3: 3, 4: 4, 5: 5}


def test_an_item_is_tried_again_by_processes_that_have_become_idle():
    assert results(die_late_at_one, range(2)) == {0: 0, 1: LOST}


def test_an_error_of_the_task_is_raised_with_its_own_traceback():
    with pytest.raises(FileNotFoundError) as caught:
        results(fail_at_three, range(6))
    assert caught.value.filename == "name"
    assert "fail_at_three" in "".join(caught.value.__notes__)
    assert not multiprocessing.active_children()


def test_what_stops_the_caller_stops_the_processes():
    def stop(*_):
        raise KeyboardInterrupt

    started = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        each(time.sleep, [0.0, 60.0, 60.0], 2, done=stop, lost=lambda _: None)
    assert not multiprocessing.active_children()
    assert time.monotonic() - started < 50.0


def test_processes_that_cannot_take_the_task_are_a_message():
    with pytest.raises(RunError, match="the worker processes die when they start"):
        results(Unreadable(), range(4))


SCRIPT = """
import os, signal, sys, time
from pathlib import Path
from flightcal.run.workers import each

def wait(path):
    Path(path).write_text(str(os.getpid()))
    time.sleep(120)

if __name__ == "__main__":
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # as the command line has it
    each(wait, sys.argv[1:], 2, done=print, lost=print)
"""


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGINT, signal.SIGTERM])
def test_processes_end_with_the_one_that_started_them(tmp_path, how):
    files = [tmp_path / name for name in ("first", "second")]
    (tmp_path / "script.py").write_text(SCRIPT)
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[2] / "src")}
    process = subprocess.Popen(
        [sys.executable, str(tmp_path / "script.py"), *map(str, files)], env=environment, start_new_session=True
    )
    try:
        wait_until(lambda: all(file.exists() and file.read_text() for file in files))
        pids = [int(file.read_text()) for file in files]
        # Ctrl-C reaches all of the group, what else there is the process alone.
        (os.killpg if how == signal.SIGINT else os.kill)(process.pid, how)
        process.wait(timeout=60)
        wait_until(lambda: not any(map(alive, pids)))
    finally:
        process.kill()


def wait_until(happened):
    deadline = time.monotonic() + 120
    while not happened():
        assert time.monotonic() < deadline
        time.sleep(0.05)


def alive(number):
    state = Path(f"/proc/{number}/stat")
    try:
        return state.read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except FileNotFoundError:
        return False
