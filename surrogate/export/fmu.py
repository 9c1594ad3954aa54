"""FMI 2.0 co-simulation unit: power in, temperature rise out, exact for power that is constant over each step.

Built by pythonfmu: the unit carries its code and needs a Python 3 of the host (its shared library) to run, and nothing
but its standard library. Each communication step h is the exponential update

    x_k(t + h) = exp(-rate_k h) x_k(t) + (1 - exp(-rate_k h)) / rate_k sum_i B_ki P_i,    z_j = sum_k C_jk x_k

and dT_j = z_j, or z_j + coefficient z_j^2 where the model has an output map.
"""

from __future__ import annotations

import importlib.util
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from thermofem import checks
from thermofem.dataset import write_whole

from .header import identifiers
from .modes import Modes, modes

NEEDS = "Runs on a Python 3 of the host (standard library only). Power is held constant over each communication step."

SLAVE = '''"""{title}"""

import math
from xml.etree.ElementTree import Element, SubElement

from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Real

RATE = {rate}
B = {B}
C = {C}
POWER = {power}
RISE = {rise}
COEFFICIENT = {coefficient}  # 1/K, of the output map
UNITS = {{"W": {{"kg": "1", "m": "2", "s": "-3"}}, "K": {{"K": "1"}}}}


class {name}(Fmi2Slave):
    description = {description}

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.x = [0.0] * len(RATE)
        self.step, self.decay = None, None
        for (variable, part) in POWER:
            setattr(self, variable, 0.0)
            words = "power absorbed by " + part
            kind = {{"causality": Fmi2Causality.input, "variability": Fmi2Variability.continuous}}
            self.register_variable(Real(variable, start=0.0, description=words, **kind))
        for (variable, part) in RISE:
            setattr(self, variable, 0.0)
            words = "temperature rise of " + part + " above ambient"
            kind = {{"causality": Fmi2Causality.output, "variability": Fmi2Variability.continuous}}
            self.register_variable(Real(variable, description=words, **kind))

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

    def do_step(self, current_time, step_size):
        if step_size != self.step:
            self.step = step_size
            self.decay = [(math.exp(-rate * step_size), -math.expm1(-rate * step_size) / rate) for rate in RATE]
        power = [getattr(self, variable) for (variable, _) in POWER]
        for k, (decay, driven) in enumerate(self.decay):
            heat = sum(b * p for b, p in zip(B[k], power))
            self.x[k] = decay * self.x[k] + driven * heat
        for (variable, _), row in zip(RISE, C):
            z = sum(c * x for c, x in zip(row, self.x))
            setattr(self, variable, z + COEFFICIENT * z * z)
        return True
'''


def write(model: Any, path: Path, header: list[str]) -> Path:
    """Build the unit; inputs are called power_PART, outputs delta_T_PART; see `surrogate.export_model`."""
    if importlib.util.find_spec("pythonfmu") is None:
        raise checks.MissingLibraryError('an FMU is built by pythonfmu: pip install "thermofem[fmu]"')
    found = modes(model)
    name = identifiers([path.stem])[0]
    with tempfile.TemporaryDirectory() as folder:
        script = Path(folder) / f"{name}_fmu.py"  # the class must not share its name with the module
        script.write_text(_slave(name, found, header), encoding="utf-8")
        # in a process of its own: the builder imports the script and changes sys.path
        command = [sys.executable, "-m", "pythonfmu", "build", "-f", str(script), "-d", folder]
        done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=folder)
        built = Path(folder) / f"{name}.fmu"
        if done.returncode or not built.is_file():
            raise checks.InputError(f"pythonfmu cannot build {path.name}: {done.stderr.strip()[-300:]}")
        return write_whole(path, lambda p: shutil.copyfile(built, p))


def _slave(name: str, found: Modes, header: list[str]) -> str:
    """The unit's code."""
    return SLAVE.format(
        title=header[0],
        name=name,
        description=repr(" | ".join([NEEDS, *header])),
        rate=found.rate.tolist(),
        B=found.B.tolist(),
        C=found.C.tolist(),
        coefficient=found.coefficient,
        power=[(f"power_{word}", part) for word, part in zip(identifiers(found.inputs), found.inputs, strict=True)],
        rise=[(f"delta_T_{word}", part) for word, part in zip(identifiers(found.outputs), found.outputs, strict=True)],
    )
