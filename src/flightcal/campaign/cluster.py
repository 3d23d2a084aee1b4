"""Where a campaign runs: processes of its own on this machine, or a Dask cluster that is already there."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

import dask
from distributed import Client, LocalCluster

from ..errors import RunError

_CONNECTING: Final = 10.0  # s
_NO_WORKERS: Final = 60.0  # s that a cluster may take to get its first worker
_SETTINGS: Final = {
    # A worker holds the tasks that it runs and no others, so that one that is lost costs no other run a chance.
    "distributed.scheduler.worker-saturation": 1.0,
    # A run that has killed this many workers, and then one more, is given up.
    "distributed.scheduler.allowed-failures": 2,
}


@contextmanager
def local_cluster(workers: int) -> Iterator[Client]:
    """A client of `workers` processes on this machine, one run at a time in each; they end with this process."""
    with (
        dask.config.set(_SETTINGS),
        LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            processes=True,
            dashboard_address="127.0.0.1:0",
            silence_logs=logging.CRITICAL,
        ) as cluster,
        Client(cluster, set_as_default=False) as client,
    ):
        yield client


@contextmanager
def remote_cluster(address: str) -> Iterator[Client]:
    """A client of the scheduler at `address`, such as ``tcp://host:8786``.

    Raises RunError where there is none, or where it has no worker.
    """
    try:
        client = Client(address, timeout=_CONNECTING, set_as_default=False)
    except (OSError, ValueError) as error:  # a time-out is an OSError
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise RunError(
            f"--scheduler {address}: found no Dask scheduler there within {_CONNECTING:g} s ({reason})"
        ) from None
    with client:
        try:
            client.wait_for_workers(1, timeout=_NO_WORKERS)
        except TimeoutError:
            raise RunError(
                f"--scheduler {address}: found no worker within {_NO_WORKERS:g} s, expected at least one; "
                f"start one with 'dask worker {address}'"
            ) from None
        yield client
