"""FMI 2.0 or 3.0 units, for model exchange and co-simulation: description, source and libraries in one file.

The unit holds its source and, where a compiler is found, a library for this platform and others; the host needs no
Python. Co-simulation holds the inputs over a communication step.
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
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import NamedTuple
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from thermofem import checks
from thermofem.data.files import write_whole

from .export_header import identifiers
from .formats import Target
from .poles import Poles

log = logging.getLogger("thermofem")

OUTPUT, STATE, DERIVATIVE = 1000, 2000, 4000  # first value references, as in unit.c
DURATION = 100e-6  # s, of an experiment: a ring over 2 um of oxide has settled to 1e-5 of its period after 80 us
STEP = 2e-9  # s, the communication step that the description of a ring proposes
UNITS = {"W": {"kg": 1, "m": 2, "s": -3}, "Hz": {"s": -1}, "K": {"K": 1}, "m-3": {"m": -3},
         "J": {"kg": 1, "m": 2, "s": -2}, "W^0.5": None}  # fmt: skip
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


class Quantity(NamedTuple):
    """Name, unit ("" for none) and description of an input, output or state."""

    name: str
    unit: str
    words: str


class Light(NamedTuple):
    """What the light of a ring adds to a unit of heat, before its own inputs and states and after its outputs."""

    inputs: Sequence[Quantity] = ()
    outputs: Sequence[Quantity] = ()
    states: Sequence[Quantity] = ()


class Source(NamedTuple):
    """Source of a unit: its text, C or C++ (``language``), and the headers beside it by name."""

    text: str
    language: str = "C99"
    headers: Mapping[str, str] = {}


def write_unit(target: Target, poles: Poles, source: Source, light: Light | None = None, note: str = "") -> Path:
    """Write an FMU with the poles of a thermal model, and the light of a ring; ``note`` begins its description.

    Raises InputError: an unknown platform, or a source that cannot be compiled.
    """
    for platform_name in target.platforms:
        checks.choice("platforms", platform_name, PLATFORMS)
    name = identifiers([target.path.stem])[0]
    glue = shared_source(f"fmi{target.fmi}.c")
    token = "{" + hashlib.sha256(f"{source.text}\n{glue}".encode()).hexdigest()[:32] + "}"
    variables = _variables(poles, light)
    about = " | ".join([*([note] if note else []), *target.header])
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        (root / "sources").mkdir()
        text = f'#define GUID "{token}"\n{source.text}\n{glue}'
        (root / "sources" / f"{name}.c").write_text(text, encoding="utf-8")
        description = _description(target.fmi, name, token, about, variables, light is not None)
        (root / "modelDescription.xml").write_bytes(_xml(description))
        if target.fmi == 3:
            (root / "sources" / "buildDescription.xml").write_bytes(_xml(_build_description(name)))
        _compile(root, name, target.fmi, target.platforms)
        return write_whole(target.path, lambda p: _pack(root, p))


def shared_source(file: str) -> str:
    """Text of a C file of this folder."""
    return files(__package__).joinpath(file).read_text(encoding="utf-8")


def _pack(root: Path, path: Path) -> None:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as unit:
        for file in sorted(root.rglob("*")):
            if file.is_file():
                unit.write(file, file.relative_to(root).as_posix())


def pole_numbers(poles: Poles, heated: str, read: str) -> str:
    """C source with the constants of the poles: sizes, rates, gains, and the indices of the channel of the light."""
    counts = {
        "POLES": poles.rate.size,
        "HEATED": len(poles.inputs),
        "PARTS": len(poles.outputs),
        "LIT": poles.inputs.index(heated),
        "CORE": poles.outputs.index(read),
    }
    gains = ", ".join(map(row, poles.B * 1e-9))
    reads = ", ".join(map(row, poles.C))
    lines = [f"#define {name} {value}" for name, value in counts.items()]
    lines.append(f"#define COEFFICIENT ({float(poles.coefficient)!r})")
    lines.append(f"static const double RATE[POLES] = {row(poles.rate * 1e-9)};")
    lines.append(f"static const double GAIN[POLES][HEATED] = {{{gains}}};")
    lines.append(f"static const double READ[PARTS][POLES] = {{{reads}}};")
    return "\n".join(lines)


def row(values: Iterable[float]) -> str:
    """C source of an array of numbers."""
    return "{" + ", ".join(repr(float(value)) for value in values) + "}"


def _variables(poles: Poles, light: Light | None) -> list[Variable]:
    """All variables of the FMU: inputs, tolerance, outputs, states, and derivatives in the order of the states."""
    more = ", besides that of the light" if light else ""
    powers = zip(identifiers(poles.inputs), poles.inputs, strict=True)
    rises = zip(identifiers(poles.outputs), poles.outputs, strict=True)
    inputs = [Quantity(f"power_{word}", "W", f"power absorbed by {part}{more}") for word, part in powers]
    outputs = [Quantity(f"delta_T_{word}", "K", f"temperature rise of {part} above ambient") for word, part in rises]
    states = [Quantity(f"x_{k}", "K", f"pole {k}") for k in range(1, poles.rate.size + 1)]
    if light:
        inputs = [*light.inputs, *inputs]
        outputs = [*outputs, *light.outputs]
        states = [*light.states, *states]
    variables = [Variable(q.name, k, "input", q.unit, q.words, start=0.0) for k, q in enumerate(inputs)]
    if light:
        words = "relative tolerance of co-simulation"
        variables.append(Variable("rtol", len(variables), "parameter", "", words, start=1e-6))
    for k, q in enumerate(outputs):
        variables.append(Variable(q.name, OUTPUT + k, "output", q.unit, q.words))
    first = len(variables) + 1
    for k, q in enumerate(states):
        variables.append(Variable(q.name, STATE + k, "local", q.unit, q.words, start=0.0))
    for k, q in enumerate(states):
        rate = f"rate of {q.name}"
        variables.append(Variable(f"der({q.name})", DERIVATIVE + k, "local", "", rate, derivative=first + k))
    return variables


def _description(fmi: int, name: str, token: str, about: str, variables: list[Variable], integrates: bool) -> Element:
    """The model description of FMI 2.0 or 3.0; a unit that ``integrates`` proposes a tolerance and a step."""
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
    step = {"tolerance": "1e-6", "stepSize": repr(STEP)} if integrates else {}
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
