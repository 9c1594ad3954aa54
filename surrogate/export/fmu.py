"""FMI 2.0 or 3.0 co-simulation unit: power in, temperature rise out, exact for power that is constant over each step.

Built by pythonfmu or pythonfmu3: the unit carries its code and needs a Python 3 of the host (its shared library) to
run, and nothing but its standard library. Each communication step h is the exponential update

    x_k(t + h) = exp(-rate_k h) x_k(t) + (1 - exp(-rate_k h)) / rate_k sum_i B_ki P_i,    z_j = sum_k C_jk x_k

and dT_j = z_j, or z_j + coefficient z_j^2 where the model has an output map.
"""

from __future__ import annotations

import errno
import hashlib
import importlib.util
import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from thermofem import checks
from thermofem.data.files import write_whole

from .header import identifiers
from .modes import Modes, modes

NEEDS = "Runs on a Python 3 of the host (standard library only). Power is held constant over each communication step."
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
_PLACE = re.compile(r"\S*[/\\]")  # folders in a message of the builder
VERSIONS = {2: "pythonfmu", 3: "pythonfmu3"}  # of FMI -> library that builds it

UNIT = '''"""{title}"""

import math
{imports}

RATE = {rate}
B = {B}
C = {C}
POWER = {power}
RISE = {rise}
COEFFICIENT = {coefficient}  # 1/K, of the output map


class ThermalModel(Fmi{fmi}Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.modelName = {name!r}
        self.description = {description}
        self.x = [0.0] * len(RATE)
        self.step, self.decay = None, None
        self.begin()
        for variable, part in POWER:
            setattr(self, variable, 0.0)
            self.add(variable, "input", "W", "power absorbed by " + part, start=0.0)
        for variable, part in RISE:
            setattr(self, variable, 0.0)
            self.add(variable, "output", "K", "temperature rise of " + part + " above ambient")

    def do_step(self, current_time, step_size):
        if step_size != self.step:
            self.step = step_size
            self.decay = [(math.exp(-rate * step_size), -math.expm1(-rate * step_size) / rate) for rate in RATE]
        power = [getattr(self, variable) for variable, _ in POWER]
        for k, (decay, driven) in enumerate(self.decay):
            heat = sum(b * p for b, p in zip(B[k], power))
            self.x[k] = decay * self.x[k] + driven * heat
        for (variable, _), row in zip(RISE, C):
            z = sum(c * x for c, x in zip(row, self.x))
            setattr(self, variable, z + COEFFICIENT * z * z)
        return True
{variables}'''

IMPORTS = {
    2: """from xml.etree.ElementTree import Element, SubElement

from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Real

UNITS = {"W": {"kg": "1", "m": "2", "s": "-3"}, "K": {"K": "1"}}""",
    3: "from pythonfmu3 import Fmi3Causality, Fmi3Slave, Fmi3Variability, Float64, Unit",
}

VARIABLES = {
    2: '''
    def begin(self):
        pass

    def add(self, variable, causality, unit, words, **start):
        kind = {"causality": Fmi2Causality[causality], "variability": Fmi2Variability.continuous}
        self.register_variable(Real(variable, description=words, **kind, **start))

    def to_xml(self, *arguments, **options):
        """The description, with the units and the outputs' initial values, which pythonfmu leaves out."""
        root = super().to_xml(*arguments, **options)
        definitions = Element("UnitDefinitions")
        for symbol, exponents in UNITS.items():
            SubElement(SubElement(definitions, "Unit", name=symbol), "BaseUnit", exponents)
        root.insert(list(root).index(root.find("CoSimulation")) + 1, definitions)
        unknowns = SubElement(root.find("ModelStructure"), "InitialUnknowns")
        for index, variable in enumerate(root.find("ModelVariables"), start=1):
            heated = variable.get("causality") == "input"
            variable.find("Real").set("unit", "W" if heated else "K")
            if not heated:
                SubElement(unknowns, "Unknown", index=str(index))
        return root
''',
    3: """
    def begin(self):
        self.time = 0.0
        self.register_units([Unit("s", s=1), Unit("W", kg=1, m=2, s=-3), Unit("K", K=1)])
        self.add("time", "independent", "s", "time")

    def add(self, variable, causality, unit, words, **start):
        kind = {"causality": Fmi3Causality[causality], "variability": Fmi3Variability.continuous}
        self.register_variable(Float64(variable, unit=unit, description=words, **kind, **start))
""",
}


def write(model: Any, path: Path, header: list[str], *, fmi: int = 2) -> Path:
    """Build the unit; inputs are called power_PART, outputs delta_T_PART; see `surrogate.export_model`."""
    if fmi not in VERSIONS:
        raise checks.InputError(f"fmi = {fmi!r} is no version of FMI that can be built; give 2 or 3")
    library = VERSIONS[fmi]
    if importlib.util.find_spec(library) is None:
        raise checks.MissingLibraryError(f'an FMU of FMI {fmi}.0 is built by {library}: pip install "thermofem[fmu]"')
    found = modes(model)
    name = identifiers([path.stem])[0]
    with tempfile.TemporaryDirectory() as folder:
        code = _unit(name, found, header, fmi)
        # all units of a host share one Python, and with it the modules' names: two contents must have two
        script = Path(folder) / f"thermal_model_{hashlib.sha256(code.encode()).hexdigest()[:16]}.py"
        try:
            script.write_text(code, encoding="utf-8")
        except OSError as error:
            raise checks.InputError(f"{path.name} cannot be built in {folder}: {error.strerror}") from None
        # in a process of its own: the builder imports the script and changes sys.path
        command = [sys.executable, "-m", library, "build", "-f", str(script), "-d", folder]
        utf8 = {**os.environ, "PYTHONUTF8": "1"}  # the script is UTF-8, which the builder reads as the locale has it
        reading: dict[str, Any] = {"encoding": "utf-8", "errors": "backslashreplace"}
        done = subprocess.run(command, capture_output=True, check=False, cwd=folder, env=utf8, **reading)
        built = Path(folder) / f"{name}.fmu"
        if done.returncode or not built.is_file():
            full = [text for text in map(os.strerror, FULL) if text in done.stderr]
            lines = full or done.stderr.strip().splitlines() or ["no message"]
            raise checks.InputError(f"{library} cannot build {path.name}: {_PLACE.sub('', lines[-1])[-300:]}")
        return write_whole(path, lambda p: shutil.copyfile(built, p))


def _unit(name: str, found: Modes, header: list[str], fmi: int) -> str:
    """The unit's code."""
    return UNIT.format(
        title=header[0],
        name=name,
        fmi=fmi,
        imports=IMPORTS[fmi],
        variables=VARIABLES[fmi],
        description=repr(" | ".join([NEEDS, *header])),
        rate=found.rate.tolist(),
        B=found.B.tolist(),
        C=found.C.tolist(),
        coefficient=found.coefficient,
        power=[(f"power_{word}", part) for word, part in zip(identifiers(found.inputs), found.inputs, strict=True)],
        rise=[(f"delta_T_{word}", part) for word, part in zip(identifiers(found.outputs), found.outputs, strict=True)],
    )
