"""The folder of a reproduction: files of others stay, its own are made again, edited results are not believed."""

from __future__ import annotations

import json

import pytest

import thermofem as th
from thermofem_cli.reproduce import Settings, run
from thermofem_cli.reproduce.plan import stages_of
from thermofem_cli.reproduce.project import Project, WorkItem
from thermofem_cli.reproduce.stages import Stage
from thermofem_cli.reproduce.store import Result, StageStore

QUICK = Settings(quick=True)
MODEL = th.Foster(R=[1e3], tau=[1e-6])
STAGE = Stage("pulse", "", lambda job: Result({"rise_K": 15.0}, models={"rise": MODEL, "fall": MODEL}))


def project(out):
    """A reproduction of one stage that takes no time."""
    return Project(out, QUICK, (STAGE,))


def computed(out):
    """Its folder, with every kind of file."""
    (out / "data").mkdir(parents=True)
    (out / "figures").mkdir()
    made = project(out)
    made.compute(WorkItem("compute", "pulse", "", 1.0), lambda part: None)
    made.write(made.figure("fig5a.svg"), b"<svg/>")
    for path in (made.ring, made.report):
        made.write(path, b"<p>thermofem</p>")
    made.write(made.table, b'[{"paper": ""}]')
    return out


@pytest.mark.parametrize(
    "name",
    ["ring.html", "report.html", "data/table.json", "data/training.json", "data/pulse.pulse.nc", "figures/fig5a.svg"],
)
def test_files_of_others_are_not_written_over(name, tmp_path):
    """Each of them was replaced without a word, with exit code 0."""
    (tmp_path / name).parent.mkdir(exist_ok=True)
    (tmp_path / name).write_text("mine")
    hidden = tmp_path / ".x-0123456789abcdef.nc"
    hidden.touch()
    with pytest.raises(th.InputError, match=f"{name} is no file of a reproduction; move it"):
        run(tmp_path, QUICK)
    assert (tmp_path / name).read_text() == "mine"
    assert hidden.exists()


def test_a_linked_folder_of_data_is_not_followed(tmp_path):
    """Six stages were written where the link leads, and a hidden file there was deleted."""
    (tmp_path / "out").mkdir()
    (tmp_path / "other").mkdir()
    hidden = tmp_path / "other" / ".x-0123456789abcdef.nc"
    hidden.touch()
    for name in ("data", "figures"):
        link = tmp_path / "out" / name
        link.symlink_to(tmp_path / "other")
        with pytest.raises(th.InputError, match=f"{name} is a link; a reproduction writes into its own folders"):
            run(tmp_path / "out", QUICK)
        link.unlink()
    assert list((tmp_path / "other").iterdir()) == [hidden]


def test_its_own_files_are_made_again_whatever_became_of_them(tmp_path):
    out = computed(tmp_path / "out")
    for path in [path for path in out.rglob("*.*") if path.is_file() and path.name != ".reproduced"]:
        path.write_bytes(b"torn")
    project(out).check(["fig5a.svg"])
    (out / ".reproduced").write_bytes((out / ".reproduced").read_bytes() + b"\xff\0 cut off")
    project(out).check(["fig5a.svg"])
    (out / "figures" / "fig3a.svg").write_text("mine")  # what no run has written so far
    with pytest.raises(th.InputError, match=r"fig3a\.svg is no file of a reproduction"):
        project(out).check(["fig5a.svg", "fig3a.svg"])


def test_a_file_is_noted_before_it_is_written(tmp_path):
    """A run that is killed in between finds its own file again."""

    def end(*paths):
        assert not any(path.exists() for path in paths)
        assert {path.name for path in paths} == {"s.json", "s.m.json"}
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        StageStore(tmp_path, end).save("s", "key", Result(models={"m": MODEL}), 1.0)
    assert not list(tmp_path.iterdir())


def test_a_folder_of_an_earlier_version_goes_on(tmp_path):
    """Earlier versions kept no list; the numbers of a stage tell whose folder it is."""
    out = computed(tmp_path / "out")
    (out / ".reproduced").unlink()
    project(out).check(["fig5a.svg"])
    assert "report.html" in (out / ".reproduced").read_text().splitlines()
    for name in ("report.html", "ring.html", "data/table.json", "data/pulse.json"):
        content = (out / name).read_bytes()
        (out / ".reproduced").unlink()
        (out / name).write_text('{"mine": 1}')
        with pytest.raises(th.InputError, match=f"{name} is no file of a reproduction"):
            project(out).check([])
        (out / name).write_bytes(content)


def test_names_that_the_short_version_does_not_write_are_free(tmp_path):
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / "maps.json").write_text("mine")
    (tmp_path / "data" / "pulses.csv").write_text("mine")
    Project(tmp_path, QUICK, stages_of(QUICK)).check([])
    with pytest.raises(th.InputError, match=r"maps\.json is no file of a reproduction"):
        run(tmp_path, Settings())


@pytest.mark.parametrize(
    "edit",
    [
        lambda tree: tree.update(files={}),
        lambda tree: tree["files"].popitem(),
        lambda tree: tree["numbers"].update(a=2.0),
        lambda tree: tree.update(cpu_seconds=0.0),
        lambda tree: tree.pop("content_hash"),
    ],
)
def test_a_manifest_that_was_edited_is_not_believed(edit, tmp_path):
    """The hash covered the numbers alone: without an entry of "files" every later run ended in KeyError, code 70."""
    store = StageStore(tmp_path)
    store.save("s", "key", Result({"a": 1.0}, models={"m": MODEL, "n": MODEL}), 1.5)
    content = json.loads(store.manifest("s").read_text())
    store.manifest("s").write_text(json.dumps(content))
    assert set(store.load("s", "key").models) == {"m", "n"}  # another layout is no edit
    edit(content)
    store.manifest("s").write_text(json.dumps(content))
    assert store.load("s", "key") is None
