"""Independent poles: the form of a linear thermal model that circuits, co-simulation units and tables share.

dx_k/dt = -rate_k x_k + sum_i B_ki P_i,    z_j = sum_k C_jk x_k,    dT_j = z_j + coefficient z_j^2

Matrices for SciPy, MATLAB and pyMOR are in SI: E dx/dt = A x + B P, dT = C x. A Quadratic adds H and G as
`thermofem.Quadratic` has them; an output map adds its coefficient.
"""

import csv
import io
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.io import savemat

from thermofem import Foster, OutputMap, Quadratic, StateSpace, checks
from thermofem.arrays import Array
from thermofem.data.files import write_whole
from thermofem.models.state_space import eigenmodes
from thermofem.ring_temperature import detuning_output

from .export_header import comment, identifiers

LARGEST_ORDER = 500  # poles; a file of more is read slowly by every simulator, a certified reduction needs 10 to 40


@dataclass(frozen=True, eq=False)
class Poles:
    """Independent poles with their input and output coefficients.

    rate [shape (n,), 1/s]
    B [shape (n, inputs), K/J]
    C [shape (outputs, n)]: the largest entry of each column is 1 in size, so that x_k is a temperature in K.
    coefficient [1/K]: of the output map; 0 for a linear model.
    """

    rate: Array
    B: Array
    C: Array
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    coefficient: float = 0.0


def poles_of(model: Any) -> Poles:
    """The poles of a linear model or an output map, slowest last; poles that no input reaches are left out.

    Raises InputError: another kind of model, too many states, or a pole that does not decay.
    """
    if isinstance(model, StateSpace):  # of any number of inputs and outputs
        return _of_state_space(model)
    small = model.dynamics
    if isinstance(small, OutputMap):
        return replace(poles_of(small.linear), coefficient=small.coefficient)
    if not isinstance(small, Foster):
        raise checks.InputError(
            f"a {type(model).__name__} is not a set of independent poles: the format mat takes it; the others take "
            "Foster, StateSpace, Network, Cauer and OutputMap"
        )
    R = np.asarray(small.R)
    tau = np.asarray(small.tau)
    kept = R != 0
    share = np.ones((1, int(kept.sum())))
    return Poles(1 / tau[kept], (R / tau)[kept, None], share, model.inputs, model.outputs)


def _of_state_space(model: StateSpace) -> Poles:
    """`Poles` of a linear system, each state scaled to a temperature in K; its ambient is a node of the simulator."""
    model = model.without_ambient
    if model.order > LARGEST_ORDER:
        raise checks.InputError(
            f"model is a StateSpace of {model.order} states, too large for this format, which takes {LARGEST_ORDER}",
            "reduce finite elements (surrogate.reduce); of an array take fewer rings, a larger tolerance, or to='mat'",
        )
    rate, vectors = eigenmodes(model)
    B = vectors.T @ np.asarray(model.B)
    C = np.asarray(model.C) @ vectors
    scale = np.abs(C).max(axis=0)
    kept = (scale > 0) & np.any(B != 0, axis=1)
    rate, B, C, scale = rate[kept], B[kept], C[:, kept], scale[kept]
    order = np.argsort(-rate)
    return Poles(rate[order], (B * scale[:, None])[order], (C / scale)[:, order], model.inputs, model.outputs)


@dataclass(frozen=True, eq=False)
class RCNetwork:
    """R parallel to C for each pole, and the coupling of pins and poles, as SPICE and Verilog-A write it.

    R, C [shape (n,), K/W and J/K]
    shares [shape (n, inputs)]: heat into each pole per watt into each heated pin, at most 1 in size; None: one pin, all
        poles in series (Foster).
    reads [shape (outputs, n)]: coefficient of each pole's temperature in that of each pin that is read.
    parts, pins: every part once, heated ones first, and the pins named after them.
    heated, read: pins of the columns of ``shares`` and of the rows of ``reads``.
    coefficient [1/K]: of the output map dT = z + coefficient z^2, or 0.
    """

    R: Array
    C: Array
    shares: Array | None
    reads: Array
    parts: list[str]
    pins: list[str]
    heated: list[int]
    read: list[int]
    coefficient: float

    def read_by(self, pin: int) -> Array | None:
        """Coefficients of the poles' temperatures in that of a pin, shape (n,); None for a pin that is heated only."""
        return self.reads[self.read.index(pin)] if pin in self.read else None


def rc_network(model: Any, *, taken: Iterable[str]) -> RCNetwork:
    """RC network of a model of independent poles; pins are named after the parts, without the names in ``taken``."""
    found = poles_of(model)
    parts = list(dict.fromkeys([*found.inputs, *found.outputs]))
    pins = identifiers(parts, taken=taken)
    heated = [parts.index(p) for p in found.inputs]
    read = [parts.index(p) for p in found.outputs]
    if len(parts) == 1 and not found.coefficient:  # one pin and a linear model
        size, shares = found.B[:, 0] * found.C[0], None
    else:
        size = np.abs(found.B).max(axis=1)
        shares = found.B / size[:, None]
    return RCNetwork(size / found.rate, 1 / size, shares, found.C, parts, pins, heated, read, found.coefficient)


def ring_network(model: Any, wanted: str, *, taken: Iterable[str]) -> tuple[RCNetwork, str]:
    """RC network with a pin "heat" at the part that light heats, and the pin of the output that detunes it.

    wanted: the temperature that the ring reads, "core" or "light".
    """
    net = rc_network(model, taken=(*taken, "heat"))
    channel = lit_part(model, wanted)
    net.pins[net.parts.index(channel.heated)] = "heat"
    return net, net.pins[net.parts.index(channel.read)]


class LitPart(NamedTuple):
    """The input that the light of a ring heats, and the output that detunes it."""

    heated: str
    read: str


def lit_part(model: Any, wanted: str) -> LitPart:
    """The first input of a model, and the output that detunes a ring which reads ``wanted``, "core" or "light".

    Raises InputError: the model does not read that input, and reads several others.
    """
    heated = getattr(model, "heated", model.inputs)[0]
    read = detuning_output(wanted, heated, tuple(model.outputs))
    if read in model.outputs:
        return LitPart(heated, read)
    raise checks.InputError(f"model heats {heated!r} and reads {', '.join(model.outputs)}: one must be {heated!r}, too")


def write_mat(model: Any, path: Path, header: list[str]) -> Path:
    """Write A, B, C, E and the names of inputs and outputs; see `surrogate.export_model`."""
    if isinstance(model, StateSpace):
        matrices = {"E": model.E, "A": model.A, "B": model.B, "C": model.C}
    elif isinstance(model, Quadratic):
        matrices = {"E": np.eye(model.order), "A": model.A, "B": model.B[:, None], "C": model.C[None]}
        matrices |= {"H": model.H, "G": model.G}
    else:
        found = poles_of(model)
        matrices = {"E": np.eye(found.rate.size), "A": -np.diag(found.rate), "B": found.B, "C": found.C}
        if found.coefficient:
            matrices["coefficient"] = found.coefficient
    words = {"inputs": list(model.inputs), "outputs": list(model.outputs), "header": "\n".join(header)}
    return write_whole(path, lambda p: savemat(str(p), {**matrices, **words}, appendmat=False, do_compression=True))


def write_csv(model: Any, path: Path, header: list[str]) -> Path:
    """Write the columns ``tau (s)`` and ``R READ from HEATED (K/W)``; see `surrogate.export_model`."""
    found = poles_of(model)
    text = io.StringIO()
    text.write(comment(header, "#"))
    if found.coefficient:
        text.write(f"# rise: z + ({found.coefficient!r} /K) z^2, where z is what the poles add up to\n")
    rows = csv.writer(text, lineterminator="\n")
    pairs = [(j, i) for j in range(len(found.outputs)) for i in range(len(found.inputs))]
    rows.writerow(["tau (s)", *(f"R {found.outputs[j]} from {found.inputs[i]} (K/W)" for j, i in pairs)])
    for k, rate in enumerate(found.rate):
        rows.writerow([repr(float(1 / rate)), *(repr(float(found.C[j, k] * found.B[k, i] / rate)) for j, i in pairs)])
    return write_whole(path, lambda p: p.write_text(text.getvalue(), encoding="utf-8"))
