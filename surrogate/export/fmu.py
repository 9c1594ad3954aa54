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
from .poles import Poles, lit_part, poles_of
from .ring_rates import DURATION, EPSILON, Demonstration, RingRates, ring_rates

log = logging.getLogger("thermofem")

OUTPUT, STATE, DERIVATIVE = 1000, 2000, 4000  # first value references, as in unit.c
STEP = 2e-9  # s, the communication step that the description of a ring proposes
UNITS = {"W": {"kg": 1, "m": 2, "s": -3}, "Hz": {"s": -1}, "K": {"K": 1}, "m-3": {"m": -3},
         "J": {"kg": 1, "m": 2, "s": -2}, "W^0.5": None}  # fmt: skip
LIGHT_INPUTS = (
    ("power", "W", "power of a laser of phase 0 in the bus"),
    ("detuning", "Hz", "laser minus cold resonance"),
    ("in_re", "W^0.5", "more field into the bus, real part"),
    ("in_im", "W^0.5", "more field into the bus, imaginary part"),
    ("add_re", "W^0.5", "field into the add port, real part"),
    ("add_im", "W^0.5", "field into the add port, imaginary part"),
)
LIGHT_OUTPUTS = (
    ("drop", "W", "power at the drop port"),
    ("through", "W", "power at the through port"),
    ("absorbed", "W", "heat made by the light"),
    ("carriers", "m-3", "carrier density"),
    ("energy", "J", "energy of the light in the ring"),
    ("through_re", "W^0.5", "field at the through port, real part"),
    ("through_im", "W^0.5", "field at the through port, imaginary part"),
    ("drop_re", "W^0.5", "field at the drop port, real part"),
    ("drop_im", "W^0.5", "field at the drop port, imaginary part"),
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
    """A variable of the unit: its value reference, causality, unit ("" for none) and what it is."""

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
    """Write the unit, and a script that runs it in FMPy beside it; see `surrogate.export_model`."""
    for name in platforms:
        checks.choice("platforms", name, PLATFORMS)
    rates, poles, name = None if ring is None else ring_rates(ring), poles_of(model), identifiers([path.stem])[0]
    if not poles.rate.size:
        raise checks.InputError("model has R = 0 K/W at every pole: it never warms up")
    numbers = _numbers(model, poles, rates)
    code = [files(__package__).joinpath(file).read_text(encoding="utf-8") for file in ("unit.c", f"fmi{fmi}.c")]
    token = "{" + hashlib.sha256("\n".join([numbers, *code]).encode()).hexdigest()[:32] + "}"
    source = "\n".join([f'#define GUID "{token}"', numbers, *code])
    about = " | ".join([*([f"ring: {ring.name}"] if ring is not None else []), *header])
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        (root / "sources").mkdir()
        (root / "sources" / f"{name}.c").write_text(source, encoding="utf-8")
        variables = _variables(poles, rates)
        describe = _description2 if fmi == 2 else _description3
        (root / "modelDescription.xml").write_bytes(_xml(describe(name, token, about, variables, rates)))
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


def _numbers(model: Any, poles: Poles, rates: RingRates | None) -> str:
    """The numbers of the model as C."""
    heated, read = lit_part(model) if rates is not None else (poles.inputs[0], poles.outputs[0])
    counts = {
        "LIGHT": int(rates is not None),
        "POLES": poles.rate.size,
        "HEATED": len(poles.inputs),
        "PARTS": len(poles.outputs),
        "LIT": poles.inputs.index(heated),
        "CORE": poles.outputs.index(read),
    }
    lines = [f"#define {name} {value}" for name, value in counts.items()]
    scalars = {"COEFFICIENT": poles.coefficient}
    if rates is not None:
        for field in ("pump", "add", "through", "drop", "loss", "absorbed", "fca", "tpa", "g", "tau0", "a", "b"):
            scalars[field.upper()] = getattr(rates, field)
        scalars |= {"THERMAL_SHIFT": rates.thermal_shift, "KERR": rates.kerr, "EPSILON": EPSILON}
        lines.append(f"#define TERMS {len(rates.dispersion)}")
    lines += [f"#define {name} ({float(value)!r})" for name, value in scalars.items()]
    if rates is not None:
        lines.append(_array("DISPERSION[TERMS]", [c for c, _ in rates.dispersion]))
        lines.append(_array("EXPONENT[TERMS]", [p for _, p in rates.dispersion]))
    lines.append(_array("RATE[POLES]", poles.rate * 1e-9))
    lines.append(f"static const double GAIN[POLES][HEATED] = {{{', '.join(map(_row, poles.B * 1e-9))}}};")
    lines.append(f"static const double READ[PARTS][POLES] = {{{', '.join(map(_row, poles.C))}}};")
    return "\n".join(lines)


def _row(values: Any) -> str:
    return "{" + ", ".join(repr(float(value)) for value in values) + "}"


def _array(name: str, values: Any) -> str:
    return f"static const double {name} = {_row(values)};"


def _variables(poles: Poles, rates: RingRates | None) -> list[Variable]:
    """All variables; the states come last but for their derivatives, which are in the same order."""
    light = LIGHT_INPUTS if rates is not None else ()
    inputs = [*light]
    for word, part in zip(identifiers(poles.inputs), poles.inputs, strict=True):
        inputs.append(
            (f"power_{word}", "W", f"power absorbed by {part}" + (", besides that of the light" if light else ""))
        )
    outputs = [
        (f"delta_T_{word}", "K", f"temperature rise of {part} above ambient")
        for word, part in zip(identifiers(poles.outputs), poles.outputs, strict=True)
    ]
    outputs += LIGHT_OUTPUTS if light else ()
    states = [("a_re", "", "field in sqrt(fJ), real part"), ("a_im", "", "field in sqrt(fJ), imaginary part"),
              ("density", "", "carriers in 1e23/m^3")] if light else []  # fmt: skip
    states += [(f"x_{k}", "K", f"pole {k}") for k in range(1, poles.rate.size + 1)]
    found = [Variable(name, k, "input", unit, words, start=0.0) for k, (name, unit, words) in enumerate(inputs)]
    if light:
        found.append(Variable("rtol", len(found), "parameter", "", "relative tolerance of co-simulation", start=1e-6))
    found += [Variable(name, OUTPUT + k, "output", unit, words) for k, (name, unit, words) in enumerate(outputs)]
    first = len(found) + 1
    found += [
        Variable(name, STATE + k, "local", unit, words, start=0.0) for k, (name, unit, words) in enumerate(states)
    ]
    for k, (name, _, _) in enumerate(states):
        found.append(Variable(f"der({name})", DERIVATIVE + k, "local", "", f"rate of {name}", derivative=first + k))
    return found


def _unit_definitions(parent: Element, variables: list[Variable], tag: str) -> None:
    definitions = SubElement(parent, "UnitDefinitions")
    for name in dict.fromkeys(v.unit for v in variables if v.unit):
        unit = SubElement(definitions, "Unit", name=name)
        if UNITS[name]:
            SubElement(unit, tag, {key: str(value) for key, value in (UNITS[name] or {}).items()})


def _experiment(rates: RingRates | None) -> dict[str, str]:
    step = {"tolerance": "1e-6", "stepSize": repr(STEP)} if rates is not None else {}
    return {"startTime": "0", "stopTime": repr(DURATION)} | step


def _description2(name: str, guid: str, about: str, variables: list[Variable], rates: RingRates | None) -> Element:
    """The model description of FMI 2.0."""
    root = Element("fmiModelDescription", fmiVersion="2.0", modelName=name, guid=guid, description=about,
                   generationTool="thermofem", numberOfEventIndicators="0")  # fmt: skip
    keep = {"canGetAndSetFMUstate": "true", "canSerializeFMUstate": "true"}
    for kind, more in (
        ("ModelExchange", {"completedIntegratorStepNotNeeded": "true"}),
        ("CoSimulation", {"canHandleVariableCommunicationStepSize": "true"}),
    ):
        element = SubElement(root, kind, {"modelIdentifier": name} | more | keep)
        SubElement(SubElement(element, "SourceFiles"), "File", name=f"{name}.c")
    _unit_definitions(root, variables, "BaseUnit")
    SubElement(root, "DefaultExperiment", _experiment(rates))
    listed = SubElement(root, "ModelVariables")
    for v in variables:
        variability = {"variability": "fixed" if v.causality == "parameter" else "continuous"}
        initial = {"output": "calculated", "local": "exact" if v.derivative is None else "calculated"}.get(v.causality)
        element = SubElement(listed, "ScalarVariable", {"name": v.name, "valueReference": str(v.reference),
            "causality": v.causality, "description": v.words} | variability
            | ({"initial": initial} if initial else {}))  # fmt: skip
        real = {"unit": v.unit} if v.unit else {}
        real |= {} if v.start is None else {"start": repr(v.start)}
        SubElement(element, "Real", real | ({"derivative": str(v.derivative)} if v.derivative else {}))
    outputs = [k for k, v in enumerate(variables, 1) if v.causality == "output"]
    rates_at = [k for k, v in enumerate(variables, 1) if v.derivative]
    structure = SubElement(root, "ModelStructure")
    for tag, indices in (("Outputs", outputs), ("Derivatives", rates_at), ("InitialUnknowns", [*outputs, *rates_at])):
        element = SubElement(structure, tag)
        for index in indices:
            SubElement(element, "Unknown", index=str(index))
    return root


def _description3(name: str, token: str, about: str, variables: list[Variable], rates: RingRates | None) -> Element:
    """The model description of FMI 3.0."""
    root = Element("fmiModelDescription", fmiVersion="3.0", modelName=name, instantiationToken=token,
                   description=about, generationTool="thermofem")  # fmt: skip
    keep = {"canGetAndSetFMUState": "true", "canSerializeFMUState": "true", "modelIdentifier": name}
    SubElement(root, "ModelExchange", keep | {"needsCompletedIntegratorStep": "false"})
    SubElement(root, "CoSimulation", keep | {"canHandleVariableCommunicationStepSize": "true"})
    _unit_definitions(root, variables, "BaseUnit")
    SubElement(root, "DefaultExperiment", _experiment(rates))
    listed = SubElement(root, "ModelVariables")
    time = {"name": "time", "valueReference": "9999", "causality": "independent", "variability": "continuous"}
    SubElement(listed, "Float64", time)
    structure = SubElement(root, "ModelStructure")
    for v in variables:
        element = {"name": v.name, "valueReference": str(v.reference), "causality": v.causality, "description": v.words}
        element["variability"] = "fixed" if v.causality == "parameter" else "continuous"
        if v.causality in ("output", "local"):
            element["initial"] = "calculated" if v.start is None else "exact"
        element |= {"unit": v.unit} if v.unit else {}
        element |= {} if v.start is None else {"start": repr(v.start)}
        element |= {"derivative": str(variables[v.derivative - 1].reference)} if v.derivative else {}
        SubElement(listed, "Float64", element)
    for tag, chosen in (
        ("Output", [v for v in variables if v.causality == "output"]),
        ("ContinuousStateDerivative", [v for v in variables if v.derivative]),
        ("InitialUnknown", [v for v in variables if v.causality == "output" or v.derivative]),
    ):
        for v in chosen:
            SubElement(structure, tag, valueReference=str(v.reference))
    return root


def _build_description(name: str) -> Element:
    """What FMI 3.0 wants to know of a source."""
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

    $CC or the system's compiler serves this platform, ziglang any; without a compiler the unit holds its source only.
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
    """A script that runs the unit of a ring in FMPy."""
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
