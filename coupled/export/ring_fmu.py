"""FMI unit of a ring whole, with its light, carriers and heat, and a script that runs it in FMPy.

Co-simulation integrates with Rodas4 at the tolerance of the experiment, by default 1e-6.
"""

from pathlib import Path

from thermofem.data.files import write_whole
from thermofem.export.export_header import plain_name
from thermofem.export.fmi_unit import (
    DURATION,
    STEP,
    Light,
    Quantity,
    Source,
    pole_numbers,
    row,
    shared_source,
    write_unit,
)
from thermofem.export.formats import Target
from thermofem.export.poles import poles_of
from thermofem.models import ThermalModel

from ..resonator import RingResonator
from .lit_part import lit_part
from .ring_rates import EPSILON, Demonstration, RingRates, ring_rates


def _field(name: str, words: str) -> tuple[Quantity, ...]:
    """Name, unit and description of the real part and of the imaginary part of a field."""
    return tuple(Quantity(f"{name}_{part[:2]}", "W^0.5", f"{words}, {part} part") for part in ("real", "imaginary"))


LIGHT_INPUTS = (
    Quantity("power", "W", "power of a laser of phase 0 in the bus"),
    Quantity("detuning", "Hz", "laser minus cold resonance"),
    *_field("in", "more field into the bus"),
    *_field("add", "field into the add port"),
)
LIGHT_OUTPUTS = (
    Quantity("drop", "W", "power at the drop port"),
    Quantity("through", "W", "power at the through port"),
    Quantity("absorbed", "W", "heat made by the light"),
    Quantity("carriers", "m-3", "carrier density"),
    Quantity("energy", "J", "energy of the light in the ring"),
    *_field("through", "field at the through port"),
    *_field("drop", "field at the drop port"),
)
LIGHT_STATES = (
    Quantity("a_re", "", "field in sqrt(fJ), real part"),
    Quantity("a_im", "", "field in sqrt(fJ), imaginary part"),
    Quantity("density", "", "carriers in 1e23/m^3"),
)


def write(ring: RingResonator, model: ThermalModel, target: Target, run: Demonstration | None) -> Path:
    """Write the unit, and a script that runs it in FMPy beside it; see `coupled.export_ring`."""
    rates = ring_rates(ring)
    poles = poles_of(model)
    channel = lit_part(model, ring.read)
    numbers = pole_numbers(poles, channel.heated, channel.read)
    text = "\n".join(["#define LIGHT 1", _light_numbers(rates), numbers, shared_source("unit.c")])
    light = Light(LIGHT_INPUTS, LIGHT_OUTPUTS, LIGHT_STATES)
    if run is not None:
        demo = target.path.with_name(f"{target.path.stem}_demo.py")
        script = _script(target.path, run, rates.output_port)
        write_whole(demo, lambda p: p.write_text(script, encoding="utf-8"))
    return write_unit(target, poles, Source(text), light, f"ring: {ring.name}")


def _light_numbers(rates: RingRates) -> str:
    """C source with the numbers of `RingRates`."""
    scalars = {name.upper(): value for name, value in vars(rates).items() if name != "dispersion"}
    scalars["EPSILON"] = EPSILON
    lines = [f"#define TERMS {len(rates.dispersion)}"]
    lines += [f"#define {name} ({float(value)!r})" for name, value in scalars.items()]
    lines.append(f"static const double DISPERSION[TERMS] = {row(c for c, _ in rates.dispersion)};")
    lines.append(f"static const double EXPONENT[TERMS] = {row(p for _, p in rates.dispersion)};")
    return "\n".join(lines)


def _script(path: Path, run: Demonstration, port: str) -> str:
    """Python source that runs the FMU of a ring in FMPy and writes a table of the power at ``port``."""
    file, stem = plain_name(path.name), path.stem
    return f'''"""{run.power * 1e3:.9g} mW at {run.detuning / 1e9:.9g} GHz from cold.

Writes {stem}_demo.csv: time in s, {port} power in W. Needs FMPy (pip install fmpy).
The unit integrates at rtol = 1e-6: periods within 1e-5; {run.reason()}.
"""

import numpy as np
from fmpy import simulate_fmu

result = simulate_fmu(
    "{file}",
    fmi_type="CoSimulation",
    stop_time={DURATION!r},
    output_interval={STEP!r},
    start_values={{"power": {run.power!r}, "detuning": {run.detuning!r}}},
    output=["{port}"],
)
table = np.column_stack([result["time"], result["{port}"]])
np.savetxt("{stem}_demo.csv", table, delimiter=",", header="time,{port}", comments="")
'''
