"""Fuzzing of all that reads text: geometry, campaign and ring TOML, model JSON, CSV tables, waveforms, quantities,
and bytes: mesh files.

    python tests/fuzz/readers.py [minutes [seed]]     # hypothesis: edits of valid files, each failure shrunk
    python tests/fuzz/coverage.py [minutes]           # atheris, where it is installed: bytes guided by their coverage

Every input must end in a result or in one of the documented errors, `InputError` and `MissingLibraryError`, without a
warning. Whatever else comes up is printed once with the smallest input that does it; the exit code is then 1.
"""

from __future__ import annotations

import contextlib
import io
import json
import logging
import random
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import HealthCheck, given, seed, settings
from hypothesis import strategies as st

import coupled
import surrogate
import thermofem as th
from coupled import RingResonator, ring_toml
from coupled import circuit as circuits
from thermofem import waveforms
from thermofem.campaign import Campaign
from thermofem.campaign.schema import fields
from thermofem.data import files
from thermofem.data.quantity import parse
from thermofem.models.network import gate
from thermofem.waveforms import from_json
from thermofem_cli.kinds import kind_of

ROOT = Path(__file__).resolve().parents[2]
FOLDER = Path(tempfile.mkdtemp(prefix="fuzz-"))
TEXT = """0|1|-1|0.5|1e-9|1e400|-0.0|1e-30|nan|inf|true|false|null|""|100000000000000000000|"0 nm"|"-3 um"|"1e30 m"
"8 dBm"|"5 degC"|"1 K"|"80 deg"|"0 deg"|"1 W/m/K"|"void"|"Si"|"SiO2"|"core"|"box"|heated|datum|radius|width|inner_radius
outer_radius|bottom|height|[|]|{|}|[[part]]|[[layer]]|[boundary]|[material.Si]|=|,|;|:|.|#|%|\t|\0|é|"open"|"isothermal"|values|from
to|count|"part.core.radius"|"layer.box.thickness"|"µm"|R|tau|poles|A|B|C|E|G|H|kind|"Foster"|"Quadratic"|time"""
sys.path.insert(0, str(Path(__file__).resolve().parent))
import hostile  # noqa: E402 - beside this file, which tests load by its path
import hostile_tables  # noqa: E402

WORDS = [word for line in TEXT.split("\n") for word in line.split("|")] + ["\n", *hostile.BREAKS, *hostile.ODD]
WORDS += [f'"{unit}"' for unit in hostile.units() if len(unit) < 200] + hostile.numbers()


def model(text: str) -> None:
    """Model file, its provenance, and what it computes."""
    path = FOLDER / "model.json"
    path.write_text(text, encoding="utf-8", errors="surrogatepass")
    loaded = surrogate.load_model(path)
    surrogate.load_provenance(path)
    loaded.inputs, loaded.outputs  # noqa: B018 - reading them is the test
    if type(loaded) is not th.StateSpace:
        loaded.step_response([0.0, 1e-9, 1e-6])


def table(text: str) -> None:
    """CSV table."""
    path = FOLDER / "table.csv"
    path.write_text(text, encoding="utf-8", errors="surrogatepass")
    th.read_trace(path, 1e-3, time="Time", temperature="Temperature", start=0.0, baseline="293.15 K")
    with contextlib.suppress(th.InputError):
        wave = waveforms.from_json(th.read_trace(path, **DRIVEN).attrs["waveform"])
        wave(np.array([0.0, 1e-6]))


def trace(text: str) -> None:
    """Trace of an oscilloscope, and a fit of what it holds."""
    path = FOLDER / "trace.csv"
    path.write_text(text, encoding="utf-8", errors="surrogatepass")
    found = th.read_trace(path, th.Pulse(1e-3, 3e-6))
    assert np.isfinite(found["delta_T"].values).all()
    surrogate.fit_newton(found)


def geometry(text: str) -> None:
    """Geometry file, there and back."""
    section = th.CrossSection.from_toml_text(text)
    assert th.CrossSection.from_toml_text(section.to_toml()) == section, "another geometry comes back"


def campaign(text: str) -> None:
    """Campaign file, and its cases."""
    len(Campaign(**fields(text, ROOT)))


def ring(text: str) -> None:
    """Ring file."""
    RingResonator.from_text(text)


def circuit(text: str) -> None:
    """Circuit file, and the spectrum of what it describes."""
    path = FOLDER / "circuit.toml"
    path.write_text(text, encoding="utf-8", errors="surrogatepass")
    coupled.spectrum(coupled.Circuit.from_toml(path), [0.0, 1e9])


def journal(text: str) -> None:
    """Rows of a map changed by hand: each line gets the hash that belongs to it, and the map goes on."""
    path = FOLDER / "map.jsonl"
    head, *rows = text.split("\n")
    lines = [head]
    for row in rows:
        with contextlib.suppress(ValueError, RecursionError, TypeError):
            given = json.loads(row)
            row = json.dumps([*given[:2], files.digest_tree(given[:2])[:16]])
        lines.append(row)
    path.write_text("\n".join(lines), encoding="utf-8", errors="surrogatepass")
    found = coupled.pulsing_map(file=path, **MAP)
    assert (found.regime == "failed").all() or np.isfinite(found.period.values[found.regime == "self-pulsing"]).all()


def waveform(text: str) -> None:
    """Waveform of a dataset."""
    wave = from_json(text)
    wave(np.array([0.0, 1e-6]))


def mesh(text: str) -> None:
    """Mesh file, a character for each byte."""
    path = FOLDER / "ring.msh"
    path.write_bytes(text.encode("latin-1", "replace"))
    assert np.isfinite(list(th.mesh.load(path).volumes().values())).all()


def netcdf(text: str) -> None:
    """netCDF file, a character for each byte."""
    path = FOLDER / "heat.nc"
    path.write_bytes(text.encode("latin-1", "replace"))
    kind_of(path)
    th.dataset.load(path)
    th.dataset.response_of(th.load(path))


def amount(text: str) -> None:
    """Text with a unit, read as each kind of quantity."""
    for unit in ("m", "s", "W", "K", "W/m/K", "m^2*K/W", ""):
        with contextlib.suppress(th.InputError):
            parse(text, unit)


DRIVEN: dict[str, Any] = {
    "time": "Time", "temperature": "Temperature", "power": "Power", "baseline": "293.15 K", "edges": "middle"
}  # fmt: skip
MAP: dict[str, Any] = {
    "ring": coupled.borghi2021(),
    "model": th.Foster(R=[2e3], tau=[1e-7]),
    "powers": [1e-6, 2e-6],
    "detunings": [0.0, 1e9],
    "duration": 1e-9,
    "show_bar": False,
}
TARGETS: dict[str, Callable[[str], None]] = {
    "geometry": geometry,
    "campaign": campaign,
    "ring": ring,
    "model": model,
    "table": table,
    "trace": trace,
    "waveform": waveform,
    "circuit": circuit,
    "journal": journal,
    "mesh": mesh,
    "netcdf": netcdf,
    "quantity": amount,
}


LAWS = """[material.Si]
conductivity = { r = "60 W/m/K", z = "30 W/m/K", polynomial = [1e-4, -1e-7], reference = "300 K" }
specific_heat = { value = "712 J/kg/K", temperature = ["300 K", "400 K"], values = ["712 J/kg/K", "790 J/kg/K"] }
"""


def seeds() -> dict[str, list[str]]:
    """Valid files of each kind."""
    strip = th.strip_ring()
    rich = (ROOT / "docs" / "geometry.md").read_text(encoding="utf-8").split('title="heater.toml"\n')[1].split("```")[0]
    plan = '[[vary]]\npath = "part.core.radius"\nfrom = "3 um"\nto = "15 um"\nspacing = "log"\n'
    plan += '[[drive]]\npower = "1 mW"\nsquare = "1 us"\nduty = 0.3\nperiodic = true\n[probes]\nread = ["core"]\n'
    geometry_table = strip.to_toml().replace("[[", "[[geometry.").replace("\n[boundary]", "\n[geometry.boundary]")
    counted = plan.replace("spacing", "count = 3\nspacing")
    full_ring = (ring_toml.__doc__ or "").split("```toml\n")[1].split("```")[0].replace('drop_rate = "40e9 1/s"', "")
    linear = th.Foster(R=[2e3, 5e3], tau=[5e-8, 1e-6])
    eye, A, b = np.eye(2), np.array([[-3e6, 1e6], [1e6, -1.5e6]]), np.array([1e10, 0.0])
    models = [
        linear,
        th.OutputMap(linear, -4e-4),
        th.StateSpace(eye, -eye, eye[:, :1], eye[:1]),
        th.Quadratic(-1e6 * eye, np.zeros((2, 2, 2)), eye, np.ones(2), np.ones(2)),
        th.models.Cauer(R=[2e3, 5e3], C=[1e-11, 1e-10]),
        th.models.network.Network(A, b, ("core", "shell"), gate(A, b, float(-np.linalg.solve(A, b)[0])), 5.0),
    ]
    paths = [surrogate.save_model(m, FOLDER / f"{k}.json", provenance={"a": 1}) for k, m in enumerate(models)]
    waves = [th.Constant(1e-3), th.Pulse(1e-3, 1e-6), th.SquareWave(1e-3, 1e-6, 0.3), th.Telegraph(1e-3, 1e-6, 1e-5)]
    waves += [th.Chirp(1e-3, 1e-6, 2e-6, 1e-5), th.Sampled([0, 1e-6, 2e-6], [0, 1e-3, 0])]
    rows = "".join(f"{k},{293.15 + k % 3}\n" for k in range(12))
    rows_of_map = FOLDER / "seed.jsonl"
    coupled.pulsing_map(file=rows_of_map, **MAP)
    saved = FOLDER / "saved.msh"
    th.mesh.Mesh([[0, 0], [1e-6, 0], [1e-6, 1e-6], [0, 1e-6]], [[0, 1, 2], [0, 2, 3]], [0, 1], ("core", "box")).save(
        saved
    )
    kept = th.save(th.dataset.build(np.linspace(0, 1e-5, 30), np.linspace(0, 9, 30), waves[1]), FOLDER / "seed.nc")
    driven = "".join(f"{k},{293.15 + k % 3},{k // 6 % 2}\n" for k in range(24))
    t = np.linspace(-1e-6, 9e-6, 60)
    heated = linear.response(th.Pulse(1e-3, 3e-6), np.maximum(t, 0.0)) * (t > 0)
    measured = list(zip(t.tolist(), heated.tolist(), strict=True))
    increments = f"X,CH1,Start,Increment,\nSequence,Volt,-1.0e-06,{t[1] - t[0]:.6e}\n"
    return {
        "circuit": [(circuits.file.__doc__ or "").split("```toml\n")[1].split("```")[0]],
        "journal": [rows_of_map.read_text()],
        "geometry": [strip.to_toml(), f"{strip.to_toml()}\n{LAWS}", rich, th.rib_ring().to_toml(), th.disc().to_toml()],
        "campaign": [f"[geometry]\n{geometry_table}\n{counted}", f"samples = 5\n[geometry]\n{geometry_table}\n{plan}"],
        "ring": [full_ring, 'base = "borghi2021"\nloaded_q = 12000\nintrinsic_q = 1.1e5\nbuses = 1'],
        "model": [path.read_text() for path in paths],
        "table": [
            f"Time (us),Temperature (K)\n{rows}",
            f"Time (us),Temperature (K),Power (mW)\n{driven}",
            f"% COMSOL\n% Time (s)  Temperature (degC)\n{rows}".replace(",29", "  2"),
        ],
        "trace": [
            "Time (us),T (K)\n" + "".join(f"{a * 1e6:.5f},{b:.5f}\n" for a, b in measured),
            "Time;CH1\n(us);(mV)\n" + "".join(f"{a * 1e6:.5f};{b:.5f}\n".replace(".", ",") for a, b in measured),
            increments + "".join(f"{k},{b:.5f},\n" for k, (_, b) in enumerate(measured)),
            "".join(f"{a:.7f} {b:.5f}\n" for a, b in measured),
        ],
        "waveform": [th.waveforms.to_json(wave) for wave in waves],
        "mesh": [content.decode("latin-1") for content in [*hostile.meshes().values(), saved.read_bytes()]],
        "netcdf": [kept.read_bytes().decode("latin-1")],
        "quantity": ["450 nm", "8 dBm", "-10 GHz", "1.4 W/m/K", "293.15 K", "20 degC", "1e-8 m^2*K/W"],
    }


@st.composite
def edited(draw: Any, files: list[str]) -> str:
    """A valid file with up to five pieces of it replaced, doubled or taken out; JSON also as a tree."""
    text = draw(st.sampled_from(files))
    for _ in range(draw(st.integers(1, 5))):
        start = draw(st.integers(0, len(text)))
        stop = min(len(text), start + draw(st.one_of(st.just(0), st.integers(0, 6), st.integers(0, 200))))
        words = st.lists(st.sampled_from(WORDS), min_size=1, max_size=3).map(" ".join)
        numbers = st.one_of(st.integers(-(10**30), 10**30), st.floats()).map(str)
        new = draw(st.one_of(st.just(""), words, numbers, st.just(text[start:stop] * 2), st.text(max_size=8)))
        text = text[:start] + new + text[stop:]
    return text


@st.composite
def regrown(draw: Any, files: list[str]) -> str:
    """A JSON file some of whose values are replaced by any others."""
    scalars = st.one_of(st.none(), st.booleans(), st.floats(), st.integers(-5, 10**30), st.text(max_size=6))
    values = st.recursive(
        scalars, lambda x: st.one_of(st.lists(x, max_size=3), st.dictionaries(st.text(max_size=4), x, max_size=2))
    )

    def grow(node: Any) -> Any:
        if draw(st.integers(0, 9)) == 0:
            return draw(values)
        if isinstance(node, dict):
            return {key: grow(value) for key, value in node.items() if draw(st.integers(0, 19))}
        return [grow(item) for item in node] if isinstance(node, list) else node

    return json.dumps(grow(json.loads(draw(st.sampled_from(files)))))


ONCE = 400  # systematic replacements of each kind in a round
QUIET: dict[str, Any] = {"deadline": None, "database": None, "suppress_health_check": list(HealthCheck)}


def place(error: BaseException) -> str:
    """Type of an error and the last line of this project that it passed."""
    ours = [f for f in traceback.extract_tb(error.__traceback__) if "site-packages" not in f.filename]
    at = next((f for f in reversed(ours) if Path(f.filename).parent != Path(__file__).parent), ours[-1])
    return f"{type(error).__name__} at {Path(at.filename).name}:{at.lineno}: {error}"[:200]


def survives(name: str, text: str, known: dict[str, str]) -> None:
    """Run one target, which prints nothing; raise what is neither documented nor known."""
    try:
        with warnings.catch_warnings(), contextlib.redirect_stdout(io.StringIO()) as out:
            warnings.simplefilter("error")
            TARGETS[name](text)
        assert not out.getvalue(), f"prints {out.getvalue()!r:.60}"
    except (th.InputError, th.MissingLibraryError):
        pass
    except th.OutsideTrainingWarning:
        pass
    except Exception as error:
        if place(error).split(":")[:2] not in [place.split(":")[:2] for place in known]:
            raise


def replaced(name: str, texts: list[str]) -> Iterator[str]:
    """Every valid file with one line of TOML or one node of JSON replaced, left out or there twice, in random order."""
    for k, text in enumerate(texts):
        if name in ("table", "trace"):
            yield from hostile_tables.scaled_columns(text)
            for generator in (
                hostile_tables.headers,
                hostile_tables.odd_headers,
                hostile_tables.mixed,
                hostile_tables.scaled_names,
            ):
                yield from (table for _, table in generator([(f"{k}", f"{k % 7}") for k in range(20)]))
        elif name in ("mesh", "netcdf"):
            content = text.encode("latin-1")
            yield from (other.decode("latin-1") for other in hostile.damaged(content, k, 2000))
            yield from (other.decode("latin-1") for other in hostile.flipped(content, len(content)))
        elif name in ("model", "waveform"):
            yield from map(json.dumps, hostile.replaced_leaves(json.loads(text)))
        elif name in ("geometry", "campaign", "ring", "circuit"):
            yield from hostile.replaced_lines(text)
        elif name == "journal":
            head, *rows = text.splitlines()
            for k, row in enumerate(rows):
                for other in hostile.replaced_leaves(json.loads(row)):
                    yield "\n".join([head, *rows[:k], json.dumps(other), *rows[k + 1 :], ""])


def fuzz(minutes: float, start: int = 0) -> dict[str, str]:
    """Rounds of a few hundred files for each target until the time is over; place of each failure -> input.

    start: seed of the first round; the next ones count from there.
    """
    found: dict[str, str] = {}
    last: dict[str, str] = {}
    end, files, rounds = time.monotonic() + 60 * minutes, seeds(), 0
    for name, texts in files.items():
        for text in texts:
            TARGETS[name](text)  # they are valid
    systematic = {name: list(replaced(name, texts)) for name, texts in files.items()}
    for texts in systematic.values():
        random.Random(start).shuffle(texts)
    while time.monotonic() < end:
        for name in TARGETS:
            for text in systematic[name][ONCE * rounds : ONCE * (rounds + 1)]:
                try:
                    survives(name, text, found)
                except Exception as error:
                    found[place(error)] = text
                    print(f"{name}: {place(error)}\n    {text!r}"[:1500], flush=True)
            inputs = edited(files[name])
            if name in ("model", "waveform"):
                inputs = st.one_of(inputs, regrown(files[name]))

            def check(text: str) -> None:
                last[name] = text  # noqa: B023 - called before the loop goes on
                survives(name, text, found)  # noqa: B023

            options: dict[str, Any] = {"max_examples": 400, "report_multiple_bugs": False}
            run = seed(start + rounds)(settings(**options, **QUIET)(given(inputs)(check)))
            try:
                run()
            except Exception as error:
                found[place(error)] = last[name]
                print(f"{name}: {place(error)}\n    {last[name]!r}"[:1500], flush=True)
        rounds += 1
        if rounds % 20 == 0:
            print(f"{400 * rounds} files of each kind, {len(found)} failures", flush=True)
    print(f"{400 * rounds} files of each kind, {len(found)} failures")
    return found


if __name__ == "__main__":
    logging.disable(logging.WARNING)  # the log tells of files that were changed
    numbers = [float(text) for text in sys.argv[1:3]]
    sys.exit(bool(fuzz(numbers[0] if numbers else 60.0, int(numbers[1]) if len(numbers) > 1 else 0)))
