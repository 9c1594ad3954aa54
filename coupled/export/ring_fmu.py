"""FMI unit of a ring whole, with its light, carriers and heat, and a script that runs it in FMPy.

The unit compiles the headers of `coupled.kernel`: co-simulation takes its steps of Rodas4, at the tolerance of the
experiment, by default 1e-6. The size below which errors are absolute is that of 1 mW on resonance (`units.floor_of`).
"""

from importlib.resources import files
from pathlib import Path

import numpy as np

from thermofem.data.files import write_whole
from thermofem.export.export_header import Target, plain_name
from thermofem.export.fmi_unit import (
    DURATION,
    STEP,
    Light,
    Quantity,
    Source,
    pole_numbers,
    row,
    write_unit,
)
from thermofem.export.poles import poles_of
from thermofem.models import ThermalModel

from ..kernel.library import FLAGS, SOURCES, compiler
from ..kernel.tableaus import Method, tableau
from ..kernel.units import UW, internal_pump, internal_rings
from ..resonator import RingResonator
from .ring_ports import Demonstration, RingPorts, lit_part, ring_ports


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


MILLIWATT = 1e-3  # W
HEADERS = ("dual.hpp", "equations.hpp", "step.hpp", "loop.hpp", "slopes.hpp")  # of the kernel
BEGIN = """#include "loop.hpp"
#include "slopes.hpp"
#define FIRST 3
#define HEAT 6"""


def write(ring: RingResonator, model: ThermalModel, target: Target, run: Demonstration | None) -> Path:
    """Write the unit, and a script that runs it in FMPy beside it; see `coupled.export_ring`."""
    ports = ring_ports(ring)
    poles = poles_of(model)
    channel = lit_part(model, ring.read)
    gain = poles.B[:, poles.inputs.index(channel.heated)] * poles.C[poles.outputs.index(channel.read)]
    thermal_resistance = float((gain / poles.rate).sum())
    of_poles = pole_numbers(poles, channel.heated, channel.read)
    of_light = _light_numbers(ring, ports, thermal_resistance)
    numbers = "\n".join([BEGIN, of_poles, of_light, _method_numbers(Method.RODAS4)])
    headers = {name: (SOURCES / name).read_text(encoding="utf-8") for name in HEADERS}
    law = files(__package__).joinpath("ring_unit.cpp").read_text(encoding="utf-8")
    source = Source(numbers, law, _compiler(), ("-O3", *FLAGS), ".cpp", "C++17", headers)
    if run is not None:
        demo = target.path.with_name(f"{target.path.stem}_demo.py")
        script = _script(target.path, run, ports.output_port)
        write_whole(demo, lambda p: p.write_text(script, encoding="utf-8"))
    return write_unit(target, poles, source, Light(LIGHT_INPUTS, LIGHT_OUTPUTS, LIGHT_STATES), f"ring: {ring.name}")


def _compiler() -> list[str]:
    """Command of the C++ compiler of the kernel; empty where there is none."""
    try:
        return compiler()
    except RuntimeError:
        return []


def _light_numbers(ring: RingResonator, ports: RingPorts, thermal_resistance: float) -> str:
    """C++ source with the constants of light and carriers, as the kernel has them."""
    rings = internal_rings([ring], internal_pump(ring, MILLIWATT), thermal_resistance * UW)
    terms = rings.dispersion[0] if rings.dispersion.size else np.array([[0.0, 1.0]])  # (0, 1): none
    scalars = {"PUMP": ports.pump, "ADD": ports.add, "THROUGH": ports.through, "DROP": ports.drop}
    lines = [f"#define {name} ({value!r})" for name, value in scalars.items()]
    lines.append(f"static const Mode MODE = {row(rings.modes[0, 0])};")
    lines.append(f"static const Carriers CARRIERS = {row(rings.carriers[0])};")
    lines.append(f"static const Term DISPERSION[] = {{{', '.join(map(row, terms))}}};")
    lines.append(f"static const double FLOOR[] = {row(rings.floor[0])};")
    return "\n".join(lines)


def _method_numbers(method: Method) -> str:
    """C++ source with the coefficients of a Rosenbrock method."""
    table = tableau(method)
    arrays = ("a", "c", "dense", "at", "slope")
    lines = [f"static const double METHOD_{name}[] = {row(getattr(table, name).ravel())};" for name in arrays]
    addresses = ", ".join(f"METHOD_{name}" for name in arrays)
    lines.append(f"static constexpr Method METHOD = {{{len(table.a)}, {table.order}, {table.gamma!r}, {addresses}}};")
    return "\n".join(lines)


def _script(path: Path, run: Demonstration, port: str) -> str:
    """Python source that runs the FMU of a ring in FMPy and writes a table of the power at ``port``."""
    file = plain_name(path.name)
    stem = path.stem
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
