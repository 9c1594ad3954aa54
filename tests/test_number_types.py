"""A number means the same in every type: float32, longdouble, uint8 or a 0-d array give what the float gives."""

from __future__ import annotations

import dataclasses
import enum
import inspect
from decimal import Decimal

import numpy as np
import pint
import pytest
import xarray as xr

import coupled
import surrogate
import thermofem as th
from thermofem.campaign import Variation

RING = coupled.borghi2021()
MODEL = th.Foster([2000.0, 5800.0], [56e-9, 1.2e-6])
TYPES = [np.float32, np.longdouble, lambda value: np.array(np.float32(value))]
VALUES = [  # the classes, by their names and fields that are valid in every type
    th.Constant(1e-3),
    th.Pulse(1e-3, 1e-7, 1e-6),
    th.SquareWave(1e-3, 1e-6, 0.3),
    th.Chirp(1e-3, 1e-7, 1e-6, 1e-5),
    th.Telegraph(1e-3, 1e-7, 1e-5, 1),
    th.Symbols([0, 1], 1e6, 1e-3, bias=1e-4),
    th.Layer("box", "SiO2", 2e-6),
    th.Part("core", "Si", 4e-6, 5e-6, 1e-8, 2e-7),
    th.Boundary("convection", 10.0),
    th.Interface("core", 1e-8),
    th.Probe("far", "core", distance=2e-5),
    th.Material("glass", 1.4, 2200.0, 700.0),
    th.PowerLaw(1.3, 300.0),
    th.strip_ring(),
    coupled.ConstantLifetime(1e-9),
    RING.carriers,
    RING,
    coupled.Waveguide("a.through", "b.in", loss=3.0, phase=0.5),
    coupled.LaserPort("in", "a.in", loss=3.0),
    coupled.Detector("out", "a.drop", 1e10),
    coupled.Splitter("half", 0.25),
]


UNITS = pint.UnitRegistry()
IN_US = [
    [1.0, 2.0] * UNITS.us,
    xr.DataArray([1.0, 2.0], attrs={"units": "us"}),
    xr.DataArray([1.0, 2.0] * UNITS.us),
    1.0 * UNITS.us,
    xr.DataArray(1.0, attrs={"units": "us"}),
]


@pytest.mark.parametrize("times", IN_US, ids=lambda v: f"{type(v).__name__}-{np.ndim(v)}")
def test_another_unit_is_no_plain_number(times):
    """NumPy took the numbers: 2 us counted as 2 s, with a warning of pint at most."""
    calls = [MODEL.step_response, th.Constant(1e-3), lambda t: th.Foster([1e3], t if np.ndim(t) else [t])]
    for call in calls if np.ndim(times) else [lambda t: th.Pulse(1e-3, t, 1e-3), lambda t: MODEL.step_response(t)]:
        with pytest.raises(th.InputError, match=r"is in mi|is in us|not an array of numbers"):
            call(times)


def test_units_in_si_and_words_that_are_none_are_taken():
    for unit in ("s", "", "9**9**9 us", "samples"):
        assert MODEL.step_response(xr.DataArray([1e-3], attrs={"units": unit}))[0] == pytest.approx(7800)


@pytest.mark.parametrize("one", VALUES, ids=lambda one: type(one).__name__)
@pytest.mark.parametrize("kind", TYPES, ids=["float32", "longdouble", "0d"])
def test_fields_are_numbers_of_python(one, kind):
    """They kept float32, in which a geometry has seven digits, and longdouble, which shapely and Numba refuse."""
    floats = [field.name for field in dataclasses.fields(one) if type(getattr(one, field.name)) is float]
    assert floats
    made = dataclasses.replace(one, **{name: kind(getattr(one, name)) for name in floats})
    for name in floats:
        assert type(getattr(made, name)) is float
        assert getattr(made, name) == float(kind(getattr(one, name)))


class Text(str):
    """Text with a repr that is no literal of Python, as numpy.str_ has since NumPy 2."""

    def __repr__(self):
        return f"Text({super().__repr__()})"

    def __str__(self):
        return "another text"


TEXTS = [np.str_, Text, lambda value: enum.StrEnum("Words", {"ONE": value}).ONE]
NAMED = [  # classes that hold lists of names
    lambda names: th.Foster([1e3], [1e-6], inputs=names, outputs=names),
    lambda names: surrogate.Cauer([1e3], [1e-9], inputs=names, outputs=names),
    lambda names: th.StateSpace(np.eye(1), -np.eye(1), np.ones((1, 1)), np.ones((1, 1)), inputs=names, outputs=names),
    lambda names: surrogate.Network(-np.eye(1), np.ones(1), names, th.Foster([1.0], [1.0]), 1.0),
    lambda names: th.Mesh(np.array([[0, 0], [1, 0], [0, 1]]), np.array([[0, 1, 2]]), np.array([0]), names),
    lambda names: Variation("box", names, values=(1.0,)),
    lambda names: coupled.Circuit(dict.fromkeys(names, RING), lasers=[coupled.LaserPort("in", "core.in")]),
]


@pytest.mark.parametrize("kind", TEXTS, ids=["numpy", "subclass", "enumeration"])
@pytest.mark.parametrize("one", VALUES, ids=lambda one: type(one).__name__)
def test_fields_are_text_of_python(one, kind):
    """Names stayed numpy.str_, whose repr "np.str_('core')" was written into files."""
    texts = [field.name for field in dataclasses.fields(one) if type(getattr(one, field.name)) is str]
    made = dataclasses.replace(one, **{name: kind(getattr(one, name)) for name in texts})
    for name in texts:
        assert type(getattr(made, name)) is str
        assert getattr(made, name) == getattr(one, name)


@pytest.mark.parametrize("kind", TEXTS, ids=["numpy", "subclass", "enumeration"])
@pytest.mark.parametrize("make", NAMED)
def test_lists_of_names_are_text_of_python(make, kind):
    """The code of an FMU held np.str_ and ended in NameError."""
    made = make((kind("core"),))
    lists = [getattr(made, name, ()) for name in ("inputs", "outputs", "names", "region_names", "paths", "rings")]
    assert {type(name) for names in lists for name in names} == {str}
    assert {name.partition(".")[0] for names in lists for name in names} == {"core"}


@pytest.mark.parametrize("make", [th.strip_ring, th.rib_ring, th.disc, th.heated_ring])
@pytest.mark.parametrize("kind", TYPES, ids=["float32", "longdouble", "0d"])
def test_rings_are_added_up_in_floats(make, kind):
    """radius - width/2 of float32 was float32."""
    given = {name: kind(one.default) for name, one in inspect.signature(make).parameters.items()}
    assert make(**given) == make(**{name: float(value) for name, value in given.items()})


def test_a_loss_of_few_bits_does_not_wrap():
    """3 dB as uint8 became 253 dB where it was negated: 10^(-loss/20) of -3 as uint8 is 10^(253/20)."""
    guide = coupled.Waveguide("a.through", "b.in", loss=np.uint8(3))
    assert type(guide.loss) is int
    assert abs(guide.transmission) == pytest.approx(10 ** (-3 / 20), rel=1e-12)


@pytest.mark.parametrize("kind", [*TYPES, np.float16], ids=["float32", "longdouble", "0d", "float16"])
@pytest.mark.parametrize(
    ("call", "value"),
    [
        (lambda x: coupled.steady_states(RING, MODEL, power=x).delta_T, 5e-3),
        (lambda x: coupled.steady_states(RING, MODEL, power=5e-3, detuning=x).delta_T, -32768.0),
        (lambda x: coupled.simulate(RING, MODEL, power=1e-3, duration=1e-9, rtol=x).delta_T, 1e-4),
        (lambda x: coupled.simulate(RING, MODEL, power=1e-3, duration=x).delta_T, 1e-6),
        (lambda x: surrogate.period_error(MODEL, MODEL, [1e-6, 2e-6], duty=x).error, 0.3),
        (lambda x: coupled.intensity_noise(1e-3, -130, bandwidth=1e7, duration=x).edges, 1e-6),
    ],
    ids=["power", "detuning", "rtol", "duration", "duty", "noise"],
)
def test_arguments_mean_the_same_in_every_type(call, value, kind):
    """float16 overflowed, longdouble ended in Numba's errors, float32 moved the result by its precision."""
    x = kind(value)
    if not np.isfinite(x) or x == 0:
        pytest.skip("out of range of the type")
    assert np.array_equal(call(x), call(float(x)))


@pytest.mark.parametrize("words", [coupled.Regime, coupled.Method])
@pytest.mark.parametrize("value", ["x", 1, None, Decimal(1), (), [], b"stable"])
def test_a_word_that_is_none_of_a_choice_is_refused(words, value):
    """The error was Python's: ValueError without a hint."""
    with pytest.raises(th.InputError, match=f"{words.__name__.lower()} = .* is unknown; "):
        words(value)


@pytest.mark.parametrize("value", ["no", None, np.array([True, False]), np.zeros(0), 0.0])
@pytest.mark.parametrize(
    "call",
    [
        lambda value: th.Part("core", "Si", 4e-6, 5e-6, 0.0, 2e-7, heated=value),
        lambda value: th.Layer("box", "SiO2", 2e-6, datum=value),
        lambda value: coupled.simulate(RING, MODEL, power=1e-3, duration=1e-9, adiabatic=value),
    ],
    ids=["heated", "datum", "adiabatic"],
)
def test_what_is_neither_true_nor_false_is_refused(call, value):
    """Arrays ended in NumPy's errors, and heated="no" was heated."""
    with pytest.raises(th.InputError, match="must be True or False"):
        call(value)


@pytest.mark.parametrize("drives", [3, 1.0, "abc", range(10**12), iter(())])
def test_drives_that_are_no_list_are_refused(drives):
    """A range without end was turned into a list; numbers were iterated."""
    with pytest.raises(th.InputError, match="must be a list of waveforms"):
        surrogate.compare({"one": MODEL}, MODEL, drives)


def test_a_name_that_is_an_array_is_refused():
    with pytest.raises(th.InputError, match="must be text"):
        th.Material(np.zeros(3), 1.4, 2200.0, 700.0)
