"""FMI 2.0 or 3.0 units, for model exchange and co-simulation, in C: the heat of a ring, or a ring whole.

The unit holds its source and, where a C compiler is found, a library for this platform and others; the host needs no
Python. Co-simulation holds the inputs over a communication step. The poles of a thermal model are then advanced
exactly; a ring is integrated with Rodas4 at the tolerance of the experiment, by default 1e-6.
"""

import hashlib
import importlib.util
import logging
import os
import platform
import shlex
import shutil
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from thermofem import checks
from thermofem.data.files import write_whole

from .export_header import identifiers, plain_name
from .poles import LitPart, Poles, lit_part, poles_of
from .ring_rates import DURATION, EPSILON, Demonstration, RingRates, ring_rates

log = logging.getLogger("thermofem")

OUTPUT, STATE, DERIVATIVE = 1000, 2000, 4000  # first value references, as in unit.c
STEP = 2e-9  # s, the communication step that the description of a ring proposes
UNITS = {"W": {"kg": 1, "m": 2, "s": -3}, "Hz": {"s": -1}, "K": {"K": 1}, "m-3": {"m": -3},
         "J": {"kg": 1, "m": 2, "s": -2}, "W^0.5": None}  # fmt: skip


def _field(name: str, words: str) -> tuple[tuple[str, str, str], ...]:
    """Name, unit and description of the real part and of the imaginary part of a field."""
    return tuple((f"{name}_{part[:2]}", "W^0.5", f"{words}, {part} part") for part in ("real", "imaginary"))


LIGHT_INPUTS = (
    ("power", "W", "power of a laser of phase 0 in the bus"),
    ("detuning", "Hz", "laser minus cold resonance"),
    *_field("in", "more field into the bus"),
    *_field("add", "field into the add port"),
)
LIGHT_OUTPUTS = (
    ("drop", "W", "power at the drop port"),
    ("through", "W", "power at the through port"),
    ("absorbed", "W", "heat made by the light"),
    ("carriers", "m-3", "carrier density"),
    ("energy", "J", "energy of the light in the ring"),
    *_field("through", "field at the through port"),
    *_field("drop", "field at the drop port"),
)
# name of a platform here -> target of ziglang, ending, folder of FMI 2.0 and of 3.0
PLATFORMS = {
    "linux": ("x86_64-linux-gnu.2.17", ".so", "linux64", "x86_64-linux"),
    "windows": ("x86_64-windows-gnu", ".dll", "win64", "x86_64-windows"),
    "macos": ("x86_64-macos", ".dylib", "darwin64", "x86_64-darwin"),
    "macos-arm": ("aarch64-macos", ".dylib", "aarch64-darwin", "aarch64-darwin"),
    "linux-arm": ("aarch64-linux-gnu.2.17", ".so", "aarch64-linux", "aarch64-linux"),
}


@dataclass(frozen=True)
class Variable:
    """A variable of the FMU: value reference, causality, unit ("" for none) and description."""

    name: str
    reference: int
    causality: str
    unit: str
    words: str
    start: float | None = None
    derivative: int | None = None
    """Index, from 1, of the state that it is the derivative of."""


def write(
    model: Any,
    path: Path,
    header: list[str],
    ring: Any = None,
    run: Demonstration | None = None,
    *,
    fmi: int = 2,
    platforms: Sequence[str] = (),
) -> Path:
    """Write the FMU, and a script that runs it in FMPy beside it; see `surrogate.export_model`."""
    for name in platforms:
        checks.choice("platforms", name, PLATFORMS)
    rates = None if ring is None else ring_rates(ring)
    poles = poles_of(model)
    name = identifiers([path.stem])[0]
    channel = lit_part(model, ring.read) if ring is not None else LitPart(poles.inputs[0], poles.outputs[0])
    numbers = _numbers(poles, rates, channel)
    code = [files(__package__).joinpath(file).read_text(encoding="utf-8") for file in ("unit.c", f"fmi{fmi}.c")]
    token = "{" + hashlib.sha256("\n".join([numbers, *code]).encode()).hexdigest()[:32] + "}"
    source = "\n".join([f'#define GUID "{token}"', numbers, *code])
    about = " | ".join([*([f"ring: {ring.name}"] if ring is not None else []), *header])
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        (root / "sources").mkdir()
        (root / "sources" / f"{name}.c").write_text(source, encoding="utf-8")
        variables = _variables(poles, rates)
        (root / "modelDescription.xml").write_bytes(_xml(_description(fmi, name, token, about, variables, rates)))
        if fmi == 3:
            (root / "sources" / "buildDescription.xml").write_bytes(_xml(_build_description(name)))
        _compile(root, name, fmi, platforms)
        if run is not None and rates is not None:
            demo = path.with_name(f"{path.stem}_demo.py")
            write_whole(demo, lambda p: p.write_text(_script(path, run, rates.output_port), encoding="utf-8"))
        return write_whole(path, lambda p: _pack(root, p))


def _pack(root: Path, path: Path) -> None:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as unit:
        for file in sorted(root.rglob("*")):
            if file.is_file():
                unit.write(file, file.relative_to(root).as_posix())


def _numbers(poles: Poles, rates: RingRates | None, channel: LitPart) -> str:
    """C source with the constants of the model: sizes, rates, gains and, for a ring, the numbers of `RingRates`."""
    counts = {
        "LIGHT": int(rates is not None),
        "POLES": poles.rate.size,
        "HEATED": len(poles.inputs),
        "PARTS": len(poles.outputs),
        "LIT": poles.inputs.index(channel.heated),
        "CORE": poles.outputs.index(channel.read),
    }
    scalars = {"COEFFICIENT": poles.coefficient}
    arrays: dict[str, Any] = {}
    if rates is not None:
        counts["TERMS"] = len(rates.dispersion)
        scalars |= {name.upper(): value for name, value in vars(rates).items() if name != "dispersion"}
        scalars["EPSILON"] = EPSILON
        arrays = {"DISPERSION[TERMS]": [c for c, _ in rates.dispersion]}
        arrays["EXPONENT[TERMS]"] = [p for _, p in rates.dispersion]
    arrays["RATE[POLES]"] = poles.rate * 1e-9
    lines = [f"#define {name} {value}" for name, value in counts.items()]
    lines += [f"#define {name} ({float(value)!r})" for name, value in scalars.items()]
    lines += [f"static const double {name} = {_row(values)};" for name, values in arrays.items()]
    lines.append(f"static const double GAIN[POLES][HEATED] = {{{', '.join(map(_row, poles.B * 1e-9))}}};")
    lines.append(f"static const double READ[PARTS][POLES] = {{{', '.join(map(_row, poles.C))}}};")
    return "\n".join(lines)


def _row(values: Any) -> str:
    return "{" + ", ".join(repr(float(value)) for value in values) + "}"


def _variables(poles: Poles, rates: RingRates | None) -> list[Variable]:
    """All variables of the FMU: inputs, tolerance, outputs, states, and derivatives in the order of the states."""
    light = rates is not None
    more = ", besides that of the light" if rates is not None else ""
    inputs = [*(LIGHT_INPUTS if light else ())]
    for word, part in zip(identifiers(poles.inputs), poles.inputs, strict=True):
        inputs.append((f"power_{word}", "W", f"power absorbed by {part}{more}"))
    outputs = [
        (f"delta_T_{word}", "K", f"temperature rise of {part} above ambient")
        for word, part in zip(identifiers(poles.outputs), poles.outputs, strict=True)
    ]
    states = [(f"x_{k}", "K", f"pole {k}") for k in range(1, poles.rate.size + 1)]
    found = [Variable(name, k, "input", unit, words, start=0.0) for k, (name, unit, words) in enumerate(inputs)]
    if light:
        found.append(Variable("rtol", len(found), "parameter", "", "relative tolerance of co-simulation", start=1e-6))
        outputs += LIGHT_OUTPUTS
        field = [(f"a_{part[:2]}", "", f"field in sqrt(fJ), {part} part") for part in ("real", "imaginary")]
        states = [*field, ("density", "", "carriers in 1e23/m^3"), *states]
    found += [Variable(name, OUTPUT + k, "output", unit, words) for k, (name, unit, words) in enumerate(outputs)]
    first = len(found) + 1
    found += [
        Variable(name, STATE + k, "local", unit, words, start=0.0) for k, (name, unit, words) in enumerate(states)
    ]
    for k, (name, _, _) in enumerate(states):
        found.append(Variable(f"der({name})", DERIVATIVE + k, "local", "", f"rate of {name}", derivative=first + k))
    return found


def _description(
    fmi: int, name: str, token: str, about: str, variables: list[Variable], rates: RingRates | None
) -> Element:
    """The model description of FMI 2.0 or 3.0."""
    guid = "guid" if fmi == 2 else "instantiationToken"
    root = Element("fmiModelDescription", {"fmiVersion": f"{fmi}.0", "modelName": name, guid: token,
        "description": about, "generationTool": "thermofem"})  # fmt: skip
    exchange = SubElement(root, "ModelExchange")
    cosimulation = SubElement(root, "CoSimulation")
    every = {"modelIdentifier": name}
    state = "state" if fmi == 2 else "State"
    keep = {f"canGetAndSetFMU{state}": "true", f"canSerializeFMU{state}": "true"}
    held = {"canHandleVariableCommunicationStepSize": "true"}
    if fmi == 2:
        root.set("numberOfEventIndicators", "0")
        exchange.attrib |= every | {"completedIntegratorStepNotNeeded": "true"} | keep
        cosimulation.attrib |= every | held | keep
        for kind in (exchange, cosimulation):
            SubElement(SubElement(kind, "SourceFiles"), "File", name=f"{name}.c")
    else:
        exchange.attrib |= keep | every | {"needsCompletedIntegratorStep": "false"}
        cosimulation.attrib |= keep | every | held
    definitions = SubElement(root, "UnitDefinitions")
    for word in dict.fromkeys(v.unit for v in variables if v.unit):
        unit = SubElement(definitions, "Unit", name=word)
        if base := UNITS[word]:
            SubElement(unit, "BaseUnit", {key: str(value) for key, value in base.items()})
    step = {"tolerance": "1e-6", "stepSize": repr(STEP)} if rates is not None else {}
    SubElement(root, "DefaultExperiment", {"startTime": "0", "stopTime": repr(DURATION)} | step)
    _list(root, fmi, variables)
    return root


def _list(root: Element, fmi: int, variables: list[Variable]) -> None:
    """Add the variables to a model description, with the lists of outputs and derivatives."""
    listed = SubElement(root, "ModelVariables")
    structure = SubElement(root, "ModelStructure")
    if fmi == 3:
        time = {"name": "time", "valueReference": "9999", "causality": "independent", "variability": "continuous"}
        SubElement(listed, "Float64", time)
    for v in variables:
        about = {"name": v.name, "valueReference": str(v.reference), "causality": v.causality, "description": v.words}
        about["variability"] = "fixed" if v.causality == "parameter" else "continuous"
        if v.causality in ("output", "local"):
            about["initial"] = "calculated" if v.start is None else "exact"
        value = ({"unit": v.unit} if v.unit else {}) | ({} if v.start is None else {"start": repr(v.start)})
        if v.derivative:
            state = v.derivative if fmi == 2 else variables[v.derivative - 1].reference
            value["derivative"] = str(state)
        if fmi == 2:
            SubElement(SubElement(listed, "ScalarVariable", about), "Real", value)
        else:
            SubElement(listed, "Float64", about | value)
    outputs = [(k, v.reference) for k, v in enumerate(variables, 1) if v.causality == "output"]
    derivatives = [(k, v.reference) for k, v in enumerate(variables, 1) if v.derivative]
    for tags, chosen in (
        (("Outputs", "Output"), outputs),
        (("Derivatives", "ContinuousStateDerivative"), derivatives),
        (("InitialUnknowns", "InitialUnknown"), outputs + derivatives),
    ):
        element = SubElement(structure, tags[0]) if fmi == 2 else structure
        for index, reference in chosen:
            if fmi == 2:
                SubElement(element, "Unknown", index=str(index))
            else:
                SubElement(element, tags[1], valueReference=str(reference))


def _build_description(name: str) -> Element:
    """The build description of FMI 3.0: language and source file of the FMU."""
    root = Element("fmiBuildDescription", fmiVersion="3.0")
    files = SubElement(SubElement(root, "BuildConfiguration", modelIdentifier=name), "SourceFileSet", language="C99")
    SubElement(files, "SourceFile", name=f"{name}.c")
    return root


def _xml(root: Element) -> bytes:
    indent(root)
    return b'<?xml version="1.0" encoding="UTF-8"?>\n' + tostring(root, encoding="utf-8") + b"\n"


def _host() -> str:
    """The name of this platform in `PLATFORMS`."""
    system = {"linux": "linux", "darwin": "macos", "win32": "windows"}.get(sys.platform, "linux")
    return f"{system}-arm" if platform.machine() in ("arm64", "aarch64") and system != "windows" else system


def _compile(root: Path, name: str, fmi: int, platforms: Sequence[str]) -> None:
    """Compile the library of each platform, by default this one.

    This platform takes $CC or the system's compiler, others ziglang; without a compiler the FMU holds its source only.
    """
    zig = [sys.executable, "-m", "ziglang", "cc"] if importlib.util.find_spec("ziglang") else None
    found = [name for name in ("cc", "gcc", "clang") if shutil.which(name)]
    native = shlex.split(os.environ.get("CC", "")) or found[:1]
    for target in platforms or (_host(),):
        triple, ending, *folders = PLATFORMS[target]
        if target == _host() and native:
            command = native
        elif zig:
            command = [*zig, "-target", triple]
        elif not platforms:
            log.warning("no C compiler is found ($CC, cc, or pip install ziglang): the unit holds its source only")
            continue
        else:
            raise checks.MissingLibraryError(f"a unit for {target} is compiled by ziglang: pip install ziglang")
        library = root / "binaries" / folders[fmi - 2] / f"{name}{ending}"
        library.parent.mkdir(parents=True)
        flags = ["-O2", "-std=c99", "-shared", "-w"] + (["-fPIC", "-fvisibility=hidden"] if ending != ".dll" else [])
        command = [*command, *flags, str(root / "sources" / f"{name}.c"), "-o", str(library)]
        done = subprocess.run([*command, *(["-lm"] if ending == ".so" else [])], capture_output=True, check=False)
        if done.returncode:
            lines = done.stderr.decode(errors="replace").strip().splitlines() or ["no message"]
            raise checks.InputError(f"{command[0]} cannot compile the unit for {target}: {lines[-1][-300:]}")
        for extra in library.parent.iterdir():  # ziglang leaves an import library and debug information for Windows
            if extra != library:
                extra.unlink()


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
