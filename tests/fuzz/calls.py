"""Public calls with one argument replaced by a thing of another type, shape or order: a result or InputError.

    python tests/fuzz/calls.py [minutes [seed]]

Prints each place once at which another error comes up; the exit code is then 1.
"""

from __future__ import annotations

import contextlib
import random
import resource
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable
from decimal import Decimal
from fractions import Fraction
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from scipy import stats

import coupled
import surrogate
import thermofem as th
from thermofem.campaign.vary import Variation

LONG = 10**400


def things() -> list[Any]:
    """Arguments that no function asks for, and those that belong to other functions."""
    plain: list[Any] = [
        None, True, 0, -0.0, -1, 3, 0.5, 1e-300, 1e300, float("nan"), float("inf"), LONG, 1j, "", "core", "a\nb",
        "\ud800", b"x", [], [[]], [1], [2, 1], [np.nan], ["a"], [None], [[1, 2], [3]], (), {}, {"core": 1e-3}, {1: 2},
        {"core": "x"}, set(), np.array([]), np.array(1.0), np.zeros((0, 3)), np.zeros((2, 2)), np.array(["a"]),
        np.array([1j]),
        np.array([True, False]), np.array([None]), np.ma.masked, np.ma.masked_array([1, 2], [0, 1]), np.float32(1e-3),
        np.timedelta64(1, "us"), range(3), range(10**12), slice(1), int, object(), Path("/nowhere/x"), Fraction(1, 3),
        Decimal("1e-6"), xr.DataArray([1.0, 2.0]), xr.Dataset(), lambda x: x, NotImplemented,
    ]  # fmt: skip
    t = np.linspace(0, 1e-5, 20)
    data = th.dataset.build(t, MODEL.response(th.Constant(1e-3), t), th.Constant(1e-3))
    broken = [
        data.isel(time=slice(None, None, -1)),
        data.isel(time=slice(0, 1)),
        data * np.nan,
        data.drop_vars("delta_T"),
    ]
    return [*plain, data, *broken, [data, data], [data, None], MODEL, RING, th.strip_ring(), th.Constant(1e-3)]


MODEL = th.Foster(R=[2e3, 5e3], tau=[5e-8, 1e-6])
RING = coupled.borghi2021()


def calls() -> dict[str, tuple[Callable[..., Any], dict[str, Any]]]:
    """Valid calls that take milliseconds: name -> function, arguments by name."""
    strip = th.strip_ring(outer_radius=30e-6, substrate=10e-6)
    heat = th.assemble(strip, 0.05)
    t = np.linspace(0, 1e-5, 60)
    data = th.dataset.build(t, MODEL.response(th.Constant(1e-3), t), th.Constant(1e-3))
    circuit = coupled.bus([RING, RING])
    light: dict[str, Any] = {"ring": RING, "model": MODEL, "power": 1e-3, "detuning": 0.0}
    plane: dict[str, Any] = {"ring": RING, "model": MODEL, "powers": [1e-3, 2e-3], "detunings": [0.0, 1e9]}
    lists = {
        name: getattr(strip, name) for name in ("layers", "parts", "interfaces", "materials", "probes", "bottom", "top")
    }
    run = partial(coupled.simulate_circuit, duration=2e-9)
    return {
        "CrossSection": (th.CrossSection, {"name": "x", "outer_radius": 30e-6, "ambient": 293.0, **lists}),
        "Part": (th.Part, {"name": "c", "material": "Si", "inner_radius": 7e-6, "outer_radius": 8e-6, "bottom": 0.0,
                           "height": 2e-7}),
        "Layer": (th.Layer, {"name": "c", "material": "Si", "thickness": 1e-6, "datum": True}),
        "rib_ring": (th.rib_ring, {"radius": 8e-6, "slab_width": 3e-6, "slab": 9e-8}),
        "Foster": (th.Foster, {"R": [1e3, 2e3], "tau": [1e-8, 1e-6], "inputs": ("a",)}),
        "Function": (th.Function, {"breakpoints": (1e-7,), "period": 1e-6, "time_scale": 1e-8, "f": abs}),
        "Telegraph": (th.Telegraph, {"power": 1e-3, "dwell": 1e-6, "duration": 1e-5, "seed": 1}),
        "solve": (th.solve, {"heat": heat, "wave": th.Constant(1e-3), "times": [1e-8, 1e-7], "heated": "core",
                             "read": ("core",), "rtol": 1e-2, "field_times": ()}),
        "derivatives": (th.derivatives, {"heat": heat, "parameters": ["material.SiO2.conductivity"], "times": [1e-7]}),
        "reduce": (surrogate.reduce, {"system": heat.system, "tolerance": 1e-2}),
        "fit_newton": (surrogate.fit_newton, {"data": data, "method": "variable projection"}),
        "fit_foster": (surrogate.fit_foster, {"data": data, "order": 2, "method": "variable projection"}),
        "fit_output_map": (surrogate.fit_output_map, {"linear": MODEL, "data": data}),
        "square_waves": (surrogate.square_waves, {"power": 1e-3, "periods": 2, "duties": (0.1,)}),
        "save_model": (surrogate.save_model, {"model": MODEL, "path": "/nowhere/m.json", "provenance": {}}),
        "simulate": (coupled.simulate, {**light, "duration": 2e-9, "heaters": None, "heated": None, "event": None}),
        "steady_states": (coupled.steady_states, {**light, "heaters": None, "heated": None, "read": None}),
        "stability_map": (coupled.stability_map, {**plane, "vary": None, "heaters": None, "heated": None}),
        "cosimulate": (coupled.cosimulate, {"ring": RING, "heat": heat, "power": 1e-3, "duration": 1e-9,
                                            "heaters": None, "field_times": ()}),
        "identify": (coupled.identify, {"ring": RING, "traces": None, "free": ["kappa"], "bounds": None}),
        "Circuit": (coupled.Circuit, {"rings": [RING], "lasers": circuit.lasers[:0], "detectors": (), "waveguides": (),
                                      "splitters": (), "name": "x"}),
        "spectrum": (coupled.spectrum, {"circuit": circuit, "detunings": [0.0, 1e9]}),
        "simulate_circuit": (run, {"circuit": circuit, "thermal": MODEL, "inputs": {"in": 1e-3}, "heaters": None}),
    }  # fmt: skip


def families(family: surrogate.Family) -> dict[str, tuple[Callable[..., Any], dict[str, Any]]]:
    """Calls of a family with one parameter."""
    (name,) = family.names
    middle = float(family.box.middle[0])
    spread = {name: stats.norm(middle, 1e-3 * middle)}
    t, R = np.linspace(0, 1e-5, 60), family.thermal_resistance(**{name: middle})
    data = th.dataset.build(t, family.at({name: middle}).response(th.Constant(1e-3), t), th.Constant(1e-3))
    aim: dict[str, Any] = {
        "family": family,
        "free": None,
        "target": {"thermal_resistance": float(R)},
        "fixed": None,
        "optics": None,
        "seed": 0,
    }
    return {
        "design": (surrogate.design, aim),
        "pareto_front": (surrogate.pareto_front, {**aim, "generations": 1}),
        "calibrate": (surrogate.calibrate, {"geometry": family, "data": data, "free": None, "noise": 1e-2,
                                            "tolerance": 1e-3}),
        "model": (family.model, {name: middle, "heated": None, "read": None}),
        "step_response": (family.step_response, {"times": [1e-7], name: middle}),
        "uncertainty": (surrogate.uncertainty, {"family": family, "distributions": spread, "samples": 2, "fixed": None,
                                                "optics": None, "seed": 0}),
    }  # fmt: skip


def jobs(table: dict[str, tuple[Callable[..., Any], dict[str, Any]]], seed: int) -> list[tuple[str, str, Any]]:
    """Every call x every argument x every thing, in random order."""
    found = [(name, argument, thing) for name, (_, given) in table.items() for argument in given for thing in things()]
    random.Random(seed).shuffle(found)
    return found


def place(error: BaseException) -> str:
    """Type of an error and the last line of this project that it passed."""
    ours = [f for f in traceback.extract_tb(error.__traceback__) if "site-packages" not in f.filename]
    return f"{type(error).__name__} at {Path(ours[-1].filename).name}:{ours[-1].lineno}"


def tried(
    table: dict[str, tuple[Callable[..., Any], dict[str, Any]]], count: int, seconds: float, seed: int = 0
) -> tuple[int, dict[str, str]]:
    """Run jobs; how many, and the places of errors that are not documented with the call that led there."""
    end, done, wrong = time.monotonic() + seconds, 0, dict[str, str]()
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):  # some calls write files
        for name, argument, thing in jobs(table, seed)[:count]:
            if time.monotonic() > end:
                break
            function, given = table[name]
            done += 1
            try:
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore")
                    function(**{**given, argument: thing})
            except (th.InputError, th.MissingLibraryError) as error:
                if "\n" in str(error):
                    wrong[f"two lines of {name}"] = f"{argument}: {error}"
            except Exception as error:
                wrong[place(error)] = f"{name}({argument}={thing!r:.80}): {error!s:.80}".replace("\n", " ")
    return done, wrong


def small_family() -> surrogate.Family:
    """A family of one parameter over a small range, trained in seconds."""
    box = Variation("box", ("layer.box.thickness",), "m", low=1.9e-6, high=2e-6)
    return surrogate.train_family(th.Campaign(th.strip_ring().to_toml(), (box,), samples=1), 5e-2)


if __name__ == "__main__":
    resource.setrlimit(resource.RLIMIT_AS, (8 * 2**30,) * 2)  # a call that asks for more ends with its name
    everything = {**calls(), **families(small_family())}
    numbers = [float(text) for text in sys.argv[1:3]]
    seconds = 60 * (numbers[0] if numbers else 10.0)
    count, found = tried(everything, 10**9, seconds, int(numbers[1]) if len(numbers) > 1 else 0)
    for where, call in found.items():
        print(where, call.encode("ascii", "backslashreplace").decode())
    print(f"{count} calls, {len(found)} places of other errors")
    sys.exit(bool(found))
