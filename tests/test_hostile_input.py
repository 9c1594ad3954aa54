"""What a search for hostile input found: each is one line of InputError, or one line on standard error."""

from __future__ import annotations

import io
import sys
import tracemalloc
import warnings
import zipfile

import numpy as np
import pytest

import surrogate
import thermofem as th
from thermofem import cli, trees


def test_a_key_that_stands_twice_is_refused():
    """The last one would win in silence: of two R_th, nobody knows which one is meant."""
    with pytest.raises(th.InputError, match="the key 'R' twice"):
        trees.from_json('{"poles": [{"R": 1, "tau": 1e-6, "R": 100}]}')


@pytest.mark.parametrize("line", ["{} = 1", "[{}]", "[[{}]]", "x = {{ {} = 1 }}"])
@pytest.mark.parametrize("word", ["a", '"a b\\""', "'c'", "d-1"])
@pytest.mark.parametrize("dot", [".", " . "])
def test_a_long_dotted_name_is_refused_before_it_takes_memory(line, word, dot):
    """tomllib keeps every prefix of a dotted name: 50 000 words of 100 kB took 10 GB."""
    tracemalloc.start()
    try:
        with pytest.raises(th.InputError, match="nested more than 40 deep"):
            trees.from_toml(line.format(dot.join([word] * 1500)))
        assert tracemalloc.get_traced_memory()[1] < 1_000_000  # 1500**2 / 2 pointers are 9 MB
    finally:
        tracemalloc.stop()


def test_text_with_dots_and_quotes_is_still_read():
    assert trees.from_toml('a.b."c.d".e = "1.5. One. Two. \\" 3."\nf = [1.0, 2.5]')["f"] == [1.0, 2.5]


@pytest.mark.parametrize("name", ["kind", "heated", "read", "geometry"])
def test_attributes_that_are_no_text_are_refused(name):
    times = np.linspace(0, 10e-6, 50)
    data = th.dataset.build(times, 10 * (1 - np.exp(-times / 1e-6)), th.Constant(1e-3))
    data.attrs[name] = np.array([1.0, 2.0])
    with pytest.raises(th.InputError, match=name):
        surrogate.fit_newton(data)


def test_a_family_that_unpacks_to_gigabytes_is_refused(tmp_path):
    path = tmp_path / "family.json"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive, archive.open("header.npy", "w") as member:
        for _ in range(410):
            member.write(bytes(1_000_000))
    with pytest.raises(th.InputError, match="more than 400000000 bytes unpacked"):
        surrogate.load_family(path)


def test_a_family_whose_header_is_deep_is_refused(tmp_path):
    memory = io.BytesIO()
    np.savez_compressed(memory, header=np.array("[" * 100_000))
    path = tmp_path / "family.json"
    path.write_bytes(memory.getvalue())
    with pytest.raises(th.InputError, match="nested more than 40 deep"):
        surrogate.load_family(path)


def test_a_lack_of_memory_is_one_line(monkeypatch, capsys):
    def hungry(**_):
        raise MemoryError("Unable to allocate 298. GiB")

    monkeypatch.setattr(cli, "app", hungry)
    with pytest.raises(SystemExit) as left:
        cli.main()
    assert left.value.code == 2
    assert capsys.readouterr().err.splitlines() == [
        "thermofem: error: it needs more memory than there is (Unable to allocate 298. GiB)"
    ]


def test_warnings_of_libraries_stay_off_the_screen(monkeypatch, capsys):
    def noisy(**_):
        with warnings.catch_warnings():
            warnings.simplefilter("always")
            warnings.warn("overflow encountered in reduce", RuntimeWarning, stacklevel=1)
            warnings.warn("far above its training", th.OutsideTrainingWarning, stacklevel=1)

    def show(message, *_, **__):
        print(message, file=sys.stderr)

    monkeypatch.setattr(warnings, "showwarning", show)
    monkeypatch.setattr(sys, "warnoptions", [])
    monkeypatch.setattr(cli, "app", noisy)
    cli.main()
    assert capsys.readouterr().err.splitlines() == ["far above its training"]
