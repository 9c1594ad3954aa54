"""The pool of worker processes: whatever dies, tasks are done or their deaths are said, and nothing waits for ever."""

from __future__ import annotations

import gc
import os
import signal
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from multiprocessing import forkserver
from multiprocessing.connection import Connection
from pathlib import Path

import pytest

from thermofem.campaign import pool as pool_module
from thermofem.campaign.pool import Pool, WorkerDiedError, WorkersDoNotStartError
from thermofem.campaign.work import follow_parent

pytestmark = pytest.mark.slow
LIMIT = 60.0  # s, in which each answer must come


@pytest.fixture
def pool():
    with Pool(2, follow_parent) as found:
        yield found


def die(folder: Path, times: int, torn: bool = False) -> int:
    """Kill this process, unless that was done often enough; ``torn``: in the middle of a result."""
    done = len(list(folder.iterdir()))
    if done == times:
        return done
    (folder / str(done)).touch()
    if torn:
        (pipe,) = (one for one in gc.get_objects() if isinstance(one, Connection) and not one.closed)
        os.write(pipe.fileno(), b"\0\1\0\0half of 65536 bytes")
    os.kill(os.getpid(), signal.SIGKILL)
    raise AssertionError


def number(value: int) -> int:
    time.sleep(0.05)
    return value


def leave(code: int) -> None:
    os._exit(code)


class Odd(Exception):  # noqa: N818
    """An exception that pickle writes and cannot read."""

    def __init__(self, one: int, two: int) -> None:
        super().__init__(f"{one} and {two}")


def odd() -> None:
    raise Odd(1, 2)


@pytest.mark.parametrize("torn", [False, True])
def test_a_killed_worker_loses_nothing(pool, torn, tmp_path):
    """A result that was cut off in its middle had `ProcessPoolExecutor` wait for ever."""
    others = [pool.submit(number, k) for k in range(4)]
    killed = pool.submit(die, tmp_path, 2, torn)
    others += [pool.submit(number, k) for k in range(4, 8)]
    assert killed.result(LIMIT) == 2
    assert [other.result(LIMIT) for other in others] == list(range(8))


def test_a_task_that_always_kills_its_worker_is_given_up(pool, tmp_path):
    killed = pool.submit(die, tmp_path, 100)
    others = [pool.submit(number, k) for k in range(8)]
    with pytest.raises(WorkerDiedError, match="died 2 times while it had only this to do"):
        killed.result(LIMIT)
    assert len(list(tmp_path.iterdir())) == 3  # once among others
    assert [other.result(LIMIT) for other in others] == list(range(8))


@pytest.mark.skipif(not hasattr(forkserver, "_forkserver"), reason="a server process")
def test_a_killed_server_is_replaced(pool):
    assert pool.submit(number, 1).result(LIMIT) == 1
    server = forkserver._forkserver._forkserver_pid
    (worker,) = pool._all
    for pid in (server, worker.process.pid):
        os.kill(pid, signal.SIGKILL)
    assert [one.result(LIMIT) for one in [pool.submit(number, k) for k in range(4)]] == list(range(4))
    assert forkserver._forkserver._forkserver_pid != server


def test_no_server_can_start(pool, monkeypatch):
    """As where the folder of temporary files has a name too long for a socket."""

    def too_long():
        raise OSError("AF_UNIX path too long")

    monkeypatch.setattr(forkserver._forkserver, "ensure_running", too_long)
    monkeypatch.setattr(forkserver, "connect_to_new_process", lambda fds: too_long())
    assert pool.submit(number, 1).result(LIMIT) == 1


def test_workers_that_never_start_are_said(monkeypatch):
    monkeypatch.setattr(pool_module, "_serve", number)  # takes one argument
    with Pool(2, follow_parent) as broken, pytest.raises(WorkersDoNotStartError, match=r"exit code 1.*__main__"):
        broken.submit(number, 1).result(LIMIT)
    with Pool(2, lambda: None) as broken, pytest.raises(Exception, match="pickle"):
        broken.submit(number, 1).result(LIMIT)


def test_a_current_folder_that_was_deleted_is_the_cause(monkeypatch, tmp_path):
    """The line said that a script calls run inside if __name__ == "__main__"."""
    monkeypatch.chdir(tmp_path)
    tmp_path.rmdir()
    with Pool(1, follow_parent) as broken, pytest.raises(WorkersDoNotStartError, match="current folder was deleted"):
        broken.submit(number, 1).result(LIMIT)


def test_exceptions_come_back(pool):
    with pytest.raises(ZeroDivisionError):
        pool.submit(divmod, 1, 0).result(LIMIT)
    with pytest.raises(RuntimeError, match="Odd: 1 and 2"):
        pool.submit(odd).result(LIMIT)
    with pytest.raises(Exception, match="pickle"):
        pool.submit(threading.Lock).result(LIMIT)
    with pytest.raises(WorkerDiedError):
        pool.submit(leave, 0).result(LIMIT)
    assert pool.submit(number, 1).result(LIMIT) == 1


def test_the_end_of_the_block_ends_workers_at_once():
    begin = time.monotonic()
    with Pool(2, follow_parent) as pool:
        jobs = [pool.submit(time.sleep, 1000.0) for _ in range(4)]
        wait = pool.submit(number, 1)
        while len(pool._all) < 2:
            time.sleep(0.01)
    assert time.monotonic() - begin < LIMIT
    assert all(job.done() for job in [*jobs, wait])


def test_many_tasks_and_deaths_at_once(pool, tmp_path):
    """Every task dies once among others and once alone."""
    folders = [tmp_path / str(k) for k in range(8)]
    for folder in folders:
        folder.mkdir()
    with ThreadPoolExecutor(4) as callers:
        jobs = callers.map(lambda folder: pool.submit(die, folder, 2).result(LIMIT), folders)
        assert list(jobs) == [2] * 8
