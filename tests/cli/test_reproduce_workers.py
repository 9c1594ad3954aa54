"""How a reproduction shares its stages between processes, and how these end."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

import thermofem as th
from thermofem_cli.reproduce import Settings
from thermofem_cli.reproduce.claims import PLACE, claims
from thermofem_cli.reproduce.plan import STAGES, stages_of
from thermofem_cli.reproduce.project import Project, WorkItem
from thermofem_cli.reproduce.sections import read
from thermofem_cli.reproduce.workers import WORTH, chains_of, crew, share

TASKS = [
    WorkItem("compute", "a", "", 1.0),
    WorkItem("compute", "b", "", 5.0),
    WorkItem("compute", "c", "", 3.0, ("a",)),
    WorkItem("compute", "d", "", 4.0, ("c", "b")),
]
MUCH = [WorkItem("compute", name, "", WORTH) for name in "ab"]
COMMAND = """
import signal
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell may have had it ignored
from thermofem import __main__
__main__.run()
"""
TREES = pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="processes are found in /proc")


def descendants(pid):
    """Processes below a process, from /proc."""
    try:
        children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    except OSError:
        return []
    return [int(one) for child in children for one in (child, *descendants(child))]


def wait_for(condition, seconds=60):
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if found := condition():
            return found
        time.sleep(0.02)
    pytest.fail(f"{condition.__name__} did not come within {seconds} s")


class Recording(Project):
    """A project whose tasks only say that they were done."""

    def compute(self, task, done):
        done(0.5)


def test_a_chain_is_the_longest_way_to_the_end():
    assert chains_of(TASKS) == {"a": 8.0, "b": 9.0, "c": 7.0, "d": 4.0}


def test_one_process_takes_the_tasks_in_order_and_says_so():
    told = []
    share(Recording(Path(), Settings(), ()), TASKS, {}, lambda task, part: told.append((task.name, part)))
    assert told == [(name, part) for name in "abcd" for part in (0.0, 0.5, 1.0)]


def test_every_stage_comes_after_its_inputs():
    for stages in (STAGES, stages_of(Settings(quick=True))):
        for k, stage in enumerate(stages):
            assert set(stage.inputs) <= {other.name for other in stages[:k]}, stage.name


def test_every_stage_is_read_by_the_report_or_by_a_stage():
    """And the report names no stage that there is not: such a row or figure would be left out without a word."""
    lead, sections = read()
    texts = [claim.ours + claim.why for claim in claims()] + [one.text for one in (*lead, *sections)]
    pictures = [picture for section in sections for picture in section.pictures]
    texts += [picture.caption for picture in pictures]
    named = {match[1].split("/")[0] for text in texts for match in PLACE.finditer(text)}
    named |= {name for picture in pictures for name in picture.stages}
    stages = {stage.name for stage in STAGES}
    assert named <= stages
    assert stages <= named | {name for stage in STAGES for name in stage.inputs}


def test_little_work_needs_no_other_process():
    quick = stages_of(Settings(quick=True))
    assert sum(stage.weight for stage in quick) < WORTH  # the one-minute version
    chain = [MUCH[0], MUCH[1]._replace(inputs=("a",))]
    for left in (chain, MUCH[:1], [MUCH[0]._replace(weight=WORTH / 4), MUCH[1]._replace(weight=WORTH / 4)]):
        with crew(Project(Path(), Settings(), quick), 64, left) as workers:
            assert not workers


@pytest.mark.slow
def test_what_stops_a_task_stops_the_run_and_every_process(tmp_path):
    project, several = Project(tmp_path, Settings(), ()), [WorkItem("draw", f"no{k}.svg", "", 1.0) for k in range(2)]
    with pytest.raises(KeyError, match="no") as caught, crew(project, 64, MUCH) as workers:  # noqa: PT012
        processes = list(workers.values())
        assert len(processes) == 2
        share(project, several, workers, lambda task, part: None)
    assert "in draw" in caught.value.__notes__[0]  # where it happened
    assert not any(process.is_alive() for process in processes)


@pytest.mark.slow
def test_a_worker_that_is_killed_is_named(tmp_path):
    project = Project(tmp_path, Settings(), ())

    def kill(task, part):
        for process in workers.values():
            os.kill(process.pid, signal.SIGKILL)

    with pytest.raises(th.InputError, match="step 'the ring' was killed"), crew(project, 2, MUCH) as workers:
        share(project, [WorkItem("explore", "the ring", "", 1.0)], workers, kill)


@TREES
@pytest.mark.slow
@pytest.mark.parametrize("moment", [0.0, 0.3, 2.0])
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_processes_end_with_the_command(number, moment, tmp_path):
    """Ctrl-C reaches every process of the terminal, in the imports of a worker, too; other signals one alone."""
    command = [sys.executable, "-c", COMMAND, "reproduce", "-o", str(tmp_path), "--threads", "2"]
    with subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, start_new_session=True
    ) as run:
        wait_for(lambda: len(descendants(run.pid)) >= 2)
        time.sleep(moment)
        below = descendants(run.pid)
        if number == signal.SIGINT:
            os.killpg(run.pid, number)
        else:
            run.send_signal(number)
        said = run.communicate()[1]
    assert run.returncode == (130 if number == signal.SIGINT else -number)
    if number == signal.SIGINT:
        assert said == "thermofem: interrupted\n"
    wait_for(lambda: not any(Path(f"/proc/{pid}").exists() for pid in below), 20)
