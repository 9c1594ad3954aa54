import math

import pytest
from hypothesis import given, settings, strategies as st
from sections import says

from thermofem.checks import InputError
from thermofem.data.quantity import parse, write
from thermofem.data.variables import VARIABLES


@pytest.mark.parametrize(
    ("text", "unit", "value"),
    [
        ("450 nm", "m", 450e-9),
        ("7.955 um", "m", 7.955e-6),
        ("2.22µm", "m", 2.22e-6),
        ("-10 GHz", "Hz", -10e9),
        ("1e-8 m^2*K/W", "m^2*K/W", 1e-8),
        ("130 W/m/K", "W/m/K", 130.0),
        ("1.38 W/(m K)", "W/m/K", 1.38),
        ("1e4 W/m^2/K", "W/m^2/K", 1e4),
        ("2.33 g/cm^3", "kg/m^3", 2330.0),
        ("1e17 1/cm^3", "1/m^3", 1e23),
        ("20 degC", "K", 293.15),
        ("90 deg", "rad", math.pi / 2),
        ("0.33", "", 0.33),
        ("33 %", "", 0.33),
        ("2330 kg/m3", "kg/m^3", 2330.0),
        ("2.33 g/cm3", "kg/m^3", 2330.0),
        ("1e4 W/m2K", "W/m^2/K", 1e4),
        ("130 W/m-K", "W/m/K", 130.0),
        ("130 W/mK", "W/m/K", 130.0),
        ("700 J/kg-K", "J/kg/K", 700.0),
        ("1e17 cm-3", "1/m^3", 1e23),
        ("5 mV/mK", "V/K", 5.0),
        (-1.3, "", -1.3),
    ],
)
def test_text_becomes_exactly_the_number_one_would_type_in_si(text, unit, value):
    assert parse(text, unit) == value


def test_dbm():
    # 1 mW * 10^(8/10); pint and this line each round a few times: 1e-14
    assert parse("8 dBm", "W") == pytest.approx(1e-3 * 10**0.8, rel=1e-14, abs=0)
    assert parse("-40 dBm", "W") == pytest.approx(1e-7, rel=1e-14, abs=0)
    assert parse("5e-324 dBm", "W") == 1e-3  # a quotient that overflows


@pytest.mark.parametrize(
    ("text", "unit", "words"),
    [
        ("450", "m", ["no unit", "a length", "450 nm"]),
        (0.45, "m", ["0.45", "no unit", "450 nm"]),
        ("450 nms", "m", ["'nms' is unknown", "a length"]),
        ("3 s", "m", ["'3 s'", "wrong dimension", "a length"]),
        ("3 W/m3", "W/m/K", ["'W/m3' is not a unit", "a thermal conductivity"]),
        ("8 dB", "W", ["wrong dimension", "a power", "8 dBm"]),
        ("0.33" + 400 * " " + "nm", "", ["does not begin with a number"]),
        ("nan nm", "m", ["does not begin with a number"]),
        ("1e9 dBm", "W", ["not finite"]),
        (None, "m", ["None does not begin with a number"]),
    ],
)
def test_what_cannot_be_is_said_in_one_line(text, unit, words):
    with pytest.raises(InputError, match="width = ") as error:
        parse(text, unit, name="width")
    says(error, *words)


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (450e-9, "m", "450 nm"),
        (7.955e-6, "m", "7.955 um"),
        (0.0, "m", "0 nm"),
        (0.0, "Hz", "0 Hz"),
        (-12e-6, "m", "-12 um"),
        (math.radians(80), "rad", "80 deg"),
        (130.0, "W/m/K", "130 W/m/K"),
        (2e-3, "W", "2 mW"),
    ],
)
def test_numbers_are_written_as_one_would(value, unit, text):
    assert write(value, unit) == text


@given(st.floats(-1, 1), st.sampled_from(["m", "s", "W", "rad", "m^2*K/W"]))
@settings(max_examples=200, deadline=None)
def test_what_is_written_reads_back_to_the_last_bit(value, unit):
    assert parse(write(value, unit), unit) == value


def test_every_field_has_a_unit_that_exists_and_a_long_name():
    import pint

    registry = pint.UnitRegistry()
    for name, field in VARIABLES.items():
        assert field.long_name, name
        if field.unit != "1":
            registry.parse_units(field.unit)
    wanted = {"time", "power", "delta_T", "energy", "carriers", "drop", "through", "absorbed", "period", "error"}
    assert wanted <= VARIABLES.keys()
