"""Executors of --workers and --scheduler: processes of this machine, or a Dask cluster."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from concurrent.futures import Executor

from thermofem.campaign.workers import processes
from thermofem.errors import InputError, MissingLibraryError


@contextlib.contextmanager
def executor_of(scheduler: str | None, workers: int | None = None) -> Iterator[Executor | None]:
    """Executor of a Dask cluster at an address, or of several processes; None where neither is asked for.

    Raises InputError: both are given, or the scheduler does not answer. Raises MissingLibraryError: no Dask.
    """
    if scheduler and workers:
        raise InputError(f"--workers {workers} and --scheduler {scheduler} exclude each other; the cluster has its own")
    if workers and workers > 1:
        with processes(workers) as pool:
            yield pool
    elif not scheduler:
        yield None
    else:
        try:
            from distributed import Client
        except ImportError:
            raise MissingLibraryError('--scheduler needs Dask: pip install "thermofem[dask]"') from None
        try:
            client = Client(scheduler, timeout="10s", set_as_default=False)
        except Exception as error:  # TypeError, too, of protocols that are not set up
            raise InputError(f"--scheduler = {scheduler!r} does not answer: {' '.join(str(error).split())}") from None
        with client:
            yield client.get_executor(pure=False)
