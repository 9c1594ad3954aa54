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
from string import Template
from typing import NamedTuple
from xml.sax.saxutils import quoteattr

from thermofem import checks
from thermofem.data.files import write_whole

from .export_header import Target, identifiers
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
    """A variable of the FMU: as a `Quantity`, with value reference and causality."""

    name: str
    unit: str
    words: str
    reference: int
    causality: str
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
    """Source of a unit.

    numbers: constants of the model. law: functions that `unit.c` calls. Both may need ``headers``, texts by file name.
    ending, language: of the source file, as FMI 3.0 calls the language.
    command, flags: of the compiler for this platform; no command: none is found.
    """

    numbers: str
    law: str
    command: list[str]
    flags: tuple[str, ...] = ("-O2", "-std=c99", "-fvisibility=hidden")
    ending: str = ".c"
    language: str = "C99"
    headers: Mapping[str, str] = {}

    def text(self, fmi: int) -> str:
        """The whole source, without the headers."""
        pieces = [_file("unit_poles.c"), self.law, _file("unit.c"), _file(f"fmi{fmi}.c")]
        return "\n".join([self.numbers, *pieces])


def write_unit(target: Target, poles: Poles, source: Source, light: Light | None = None, note: str = "") -> Path:
    """Write an FMU with the poles of a thermal model, and the light of a ring; ``note`` begins its description.

    Raises InputError: an unknown platform, or a source that cannot be compiled.
    """
    for platform_name in target.platforms:
        checks.choice("platforms", platform_name, PLATFORMS)
    name = identifiers([target.path.stem])[0]
    text = source.text(target.fmi)
    digest = hashlib.sha256("\n".join([text, *source.headers.values()]).encode()).hexdigest()
    token = f"{{{digest[:32]}}}"
    variables = _variables(poles, light)
    about = " | ".join([*([note] if note else []), *target.header])
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        sources = root / "sources"
        sources.mkdir()
        (sources / f"{name}{source.ending}").write_text(f'#define GUID "{token}"\n{text}', encoding="utf-8")
        for file, content in source.headers.items():
            (sources / file).write_text(content, encoding="utf-8")
        description = _description(target.fmi, name, token, about, variables, source)
        (root / "modelDescription.xml").write_text(description, encoding="utf-8")
        if target.fmi == 3:
            build = Template(_file("fmi3_build.xml"))
            layout = build.substitute(name=name, language=source.language, ending=source.ending)
            (sources / "buildDescription.xml").write_text(layout, encoding="utf-8")
        _compile(root, name, source, target)
        return write_whole(target.path, lambda p: _pack(root, p))


def _file(file: str) -> str:
    """Text of a file of this folder, C or a template of XML."""
    return files(__package__).joinpath(file).read_text(encoding="utf-8")


def _pack(root: Path, path: Path) -> None:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as unit:
        for file in sorted(root.rglob("*")):
            if file.is_file():
                unit.write(file, file.relative_to(root).as_posix())


def pole_numbers(poles: Poles, heated: str, read: str) -> str:
    """C source with the constants of the poles: sizes, rates, gains, and the indices of the channel of the light."""
    counts = {
        "ORDER": poles.rate.size,
        "HEATED": len(poles.inputs),
        "PARTS": len(poles.outputs),
        "LIT": poles.inputs.index(heated),
        "CORE": poles.outputs.index(read),
    }
    gains = ", ".join(map(row, poles.B * 1e-9))
    reads = ", ".join(map(row, poles.C))
    lines = [f"#define {name} {value}" for name, value in counts.items()]
    lines.append(f"#define COEFFICIENT ({float(poles.coefficient)!r})")
    lines.append(f"static const double RATE[ORDER] = {row(poles.rate * 1e-9)};")
    lines.append(f"static const double GAIN[ORDER][HEATED] = {{{gains}}};")
    lines.append(f"static const double READ[PARTS][ORDER] = {{{reads}}};")
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
    variables = [Variable(*q, k, "input", start=0.0) for k, q in enumerate(inputs)]
    if light:
        words = "relative tolerance of co-simulation"
        variables.append(Variable("rtol", "", words, len(variables), "parameter", start=1e-6))
    for k, q in enumerate(outputs):
        variables.append(Variable(*q, OUTPUT + k, "output"))
    first = len(variables) + 1
    for k, q in enumerate(states):
        variables.append(Variable(*q, STATE + k, "local", start=0.0))
    for k, q in enumerate(states):
        rate = Quantity(f"der({q.name})", "", f"rate of {q.name}")
        variables.append(Variable(*rate, DERIVATIVE + k, "local", derivative=first + k))
    return variables


def _description(fmi: int, name: str, token: str, about: str, variables: list[Variable], source: Source) -> str:
    """The model description of FMI 2.0 or 3.0; a unit with a tolerance proposes one, and a step."""
    units = []
    for word in dict.fromkeys(v.unit for v in variables if v.unit):
        base = UNITS[word]
        units.append(_element("Unit", {"name": word}, _element("BaseUnit", base) if base else ""))
    experiment = {"startTime": 0, "stopTime": DURATION}
    if any(v.name == "rtol" for v in variables):
        experiment |= {"tolerance": 1e-6, "stepSize": STEP}
    outputs = [k for k, v in enumerate(variables) if v.causality == "output"]
    derivatives = [k for k, v in enumerate(variables) if v.derivative]

    def unknowns(tag: str, numbers: list[int]) -> list[str]:
        if fmi == 2:
            return [_element("Unknown", {"index": k + 1}) for k in numbers]
        return [_element(tag, {"valueReference": variables[k].reference}) for k in numbers]

    lists = {
        "units": units,
        "variables": [_declared(fmi, v) for v in variables],
        "outputs": unknowns("Output", outputs),
        "derivatives": unknowns("ContinuousStateDerivative", derivatives),
        "initial": unknowns("InitialUnknown", outputs + derivatives),
    }
    # hosts of FMI 2.0 compile C alone
    sources = f'<SourceFiles><File name="{name}.c"/></SourceFiles>' if source.ending == ".c" else ""
    return Template(_file(f"fmi{fmi}.xml")).substitute(
        {key: "\n    ".join(elements) for key, elements in lists.items()},
        name=name,
        token=token,
        about=quoteattr(about),
        sources=sources,
        experiment=_element("DefaultExperiment", experiment),
    )


def _element(tag: str, attributes: Mapping[str, object], inside: str = "") -> str:
    """An XML element; attributes that are None are left out."""
    pairs = [f"{key}={quoteattr(str(value))}" for key, value in attributes.items() if value is not None]
    return f"<{tag} {' '.join(pairs)}>{inside}</{tag}>"


def _declared(fmi: int, v: Variable) -> str:
    """Declaration of a variable in a model description."""
    initial = "calculated" if v.start is None else "exact"
    about = {
        "name": v.name,
        "valueReference": v.reference,
        "causality": v.causality,
        "description": v.words,
        "variability": "fixed" if v.causality == "parameter" else "continuous",
        "initial": initial if v.causality in ("output", "local") else None,
    }
    state = v.reference - DERIVATIVE + STATE if v.derivative and fmi == 3 else v.derivative
    value = {"unit": v.unit or None, "start": v.start, "derivative": state}
    if fmi == 2:
        return _element("ScalarVariable", about, _element("Real", value))
    return _element("Float64", about | value)


def _host() -> str:
    """The name of this platform in `PLATFORMS`."""
    system = {"linux": "linux", "darwin": "macos", "win32": "windows"}.get(sys.platform, "linux")
    return f"{system}-arm" if platform.machine() in ("arm64", "aarch64") and system != "windows" else system


def c_compiler() -> list[str]:
    """Command of the C compiler for this platform: $CC, cc, gcc, clang or zig; empty where there is none."""
    if os.environ.get("CC"):
        return shlex.split(os.environ["CC"])
    installed = [name for name in ("cc", "gcc", "clang") if shutil.which(name)]
    return installed[:1] or (_zig(".c") if _has_zig() else [])


def _has_zig() -> bool:
    return importlib.util.find_spec("ziglang") is not None


def _zig(ending: str) -> list[str]:
    return [sys.executable, "-m", "ziglang", "cc" if ending == ".c" else "c++"]


def _compile(root: Path, name: str, source: Source, target: Target) -> None:
    """Compile the library of each platform, by default this one; without a compiler the FMU holds its source only.

    Raises MissingLibraryError: another platform, and no ziglang. InputError: the compiler fails.
    """
    for platform_name in target.platforms or (_host(),):
        triple, ending, *folders = PLATFORMS[platform_name]
        if platform_name == _host() and source.command:
            command = source.command
        elif _has_zig():
            command = _zig(source.ending)
        elif not target.platforms:
            log.warning("no compiler is found ($CC, $CXX, or pip install ziglang): the unit holds its source only")
            continue
        else:
            raise checks.MissingLibraryError(f"a unit for {platform_name} is compiled by ziglang: pip install ziglang")
        library = root / "binaries" / folders[target.fmi - 2] / f"{name}{ending}"
        library.parent.mkdir(parents=True)
        zig = ["-target", triple, "-nostdlib++"] if "ziglang" in command else []
        position = [] if ending == ".dll" else ["-fPIC"]
        file = str(root / "sources" / f"{name}{source.ending}")
        made = str(library.with_suffix(".o"))
        last = ["-lm"] if ending == ".so" else []
        # linked apart: g++ -ffast-math would link start-up code that flushes subnormal numbers in the whole process
        steps = (
            [*command, *source.flags, "-w", *zig, *position, "-c", file, "-o", made],
            [*command, "-shared", *zig, made, "-o", str(library), *last],
        )
        for step in steps:
            done = subprocess.run(step, capture_output=True, check=False)
            if done.returncode:
                break
        if done.returncode:
            lines = done.stderr.decode(errors="replace").strip().splitlines() or ["no message"]
            reason = next((line for line in lines if "error" in line), lines[-1])
            raise checks.InputError(f"{command[0]} cannot compile the unit for {platform_name}: {reason[-300:]}")
        for extra in library.parent.iterdir():  # ziglang leaves an import library and debug information for Windows
            if extra != library:
                extra.unlink()
