"""Shapes on one chip, such as racetracks and heaters: one thermal model, without a mesh in three dimensions.

A chip is uniform in its plane but for small cores and heaters. Shape j of length L_j carries the power P_j, and the
mean rise of shape i is H_ij P_j with

    H_ij(s) = mean over both shapes of G(|r - r'|; s) + l_ij [Z_ij(s) - Y_ij(s)]/(L_i L_j)

G: Green function of the bare stack (`surrogate.reduction.stack_green`), K/W.
Z: rise by the power per length of a straight section, its cores and heaters included, K m/W: the certified FEM.
Y: the same of two lines in the bare stack of that section, by the Green function.
l_ij: length along which i runs along j in one section; L_i for i = j, 0 for shapes apart.

Near the line Y and the mean of G are alike, and what is left of their difference is what the path adds to an infinite
line; the smoothing of the lanes cancels in it. The poles are shared by all channels,

    H_ij(s) = sum_k R_ijk/(1 + s/lambda_k),    lambda_k = lambda_0 + mu rho^k

with lambda_0 the slowest rate of the stack, at which its continuous spectrum begins. R_ijk solves a least-squares
problem over the frequencies, positive for i = j, with the static gain kept; poles are added until the fit is good.

Errors. The bound of each channel is the sum of
- the fit, measured at all frequencies, and the reduction of the section, which is proven;
- the mesh of the section, estimated, and the means over the shapes, by a second computation with half of the points;
- bends: w h/R^2 of the gain, with the sections w x h of both parts. Measured against the axisymmetric FEM, on circles
  of 3 to 10 um with cores of 0.45 and 2 um and with a heater: 0.4 to 0.8 of that;
- the silicon or metal of two shapes apart, which is taken as oxide: 8 % of the gain for each um^2 of w h. Measured on
  two parts 0.5 to 8 um apart in one section: 0.5 % for two cores (8 % of 0.2 um^2 are 1.6 %), 2.8 % for two heaters.
The chip has no sides, whatever the section says of its own.

The ambient reaches a shape as in the bare stack. Cores and heaters delay it by what they store: measured against the
FEM of a section, 0.12 % of a kelvin for a core of 0.1 um^2; with a heater of 0.2 um^2 on the top 0.5 % for the core and
1.6 % for the heater. The bound is 8 % for each um^2 of w h.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.optimize import nnls

from thermofem import InputError, Shape, StateSpace, checks
from thermofem.arrays import Array, Complex
from thermofem.geometry.resistor import known_resistor, recorded
from thermofem.geometry.section_parts import AMBIENT

from .array_reduction import ArrayReduction, diagonal_system, is_passive
from .layout_sections import SECTION, Layout
from .ring_pairs import FLOOR, check_stack
from .stack_green import ENDLESS

RATIOS = (3.2, 2.7, 2.3, 2.0, 1.7, 1.5)  # rho of the poles, tried in turn
ABOVE = 0.03  # mu over the slowest rate
STIFF = 30.0  # weight of the static gain in the fit
OWN, CROSS = 0.1, 0.5  # of the tolerance, for the poles; own rises are small at high frequencies, where they matter


def reduce_layout(shapes: Sequence[Shape], tolerance: float = 1e-3, *, ambient: bool = False) -> ArrayReduction:
    """Reduce shapes in the plane of a chip to one thermal model with an input and an output for each.

    Parameters
    ----------
    shapes : sequence of Shape
        on the same layers. Parts of a section that are no shapes follow every shape of that section.
    tolerance : float
        of the poles of every channel at every frequency, relative to its static gain plus a hundredth of the larger own
        gain of its two shapes; the mesh of the sections has a fifth of it.
    ambient : bool
        whether the last input is "ambient", the temperature around the chip in kelvin above that of the section.

    Returns
    -------
    ArrayReduction
        the errors of the method are in its ``error_bound``, which may therefore be above the tolerance.

    Raises
    ------
    InputError
        shapes that cross or are closer than they are thick, shapes on different layers, names that are not unique, a
        part of a section that reaches beyond half of the way to another shape, or a tolerance out of reach; the ambient
        of a stack on an open bottom.

    >>> from thermofem import racetrack, straight_guide
    >>> section = straight_guide(substrate=20e-6)
    >>> pair = reduce_layout([racetrack("ring 1", section), racetrack("ring 2", section, at=(24e-6, 0.0))])
    >>> (pair.crosstalk / 1e3).round(2).tolist()  # K/mW
    [[8.36, 0.03], [0.03, 8.36]]
    """
    tolerance = checks.between("tolerance", tolerance, 5e-5, 0.1, hint="it is relative to the static gain")
    shapes = checks.instances("shapes", shapes, Shape)
    checks.enough("shapes", len(shapes), 1, "shapes")
    checks.unique("names of the shapes", [shape.name for shape in shapes])
    for number, shape in enumerate(shapes):
        check_stack(shapes[0].section, shape.section, f"shapes[{number}] and shapes[0]")
    layout = Layout.of(shapes, tolerance)
    omega = layout.frequencies(tolerance)
    H, error = layout.response(omega)
    inputs = [shape.name for shape in shapes]
    if ambient:
        if layout.stack.endless:
            hint = "make the bottom isothermal or convective"
            raise InputError(
                "ambient = True: no ambient reaches a chip on an open bottom, which goes on for ever", hint
            )
        follows, neglected = layout.ambient(omega)
        H = np.dstack([H, follows])
        error = np.column_stack([error, neglected])
        inputs.append(AMBIENT)
    reference = np.abs(H[0])
    own = reference.diagonal()
    reference[:, : len(shapes)] += FLOOR * np.maximum.outer(own, own)
    poles = fitted(H, omega, layout.stack.slowest, reference, tolerance)
    worst = poles.error.max()
    if worst > tolerance:
        raise InputError(f"tolerance = {tolerance:g} is out of reach: the poles leave {worst:.1e}; loosen it")
    bounds = poles.error + error / reference
    model = _model(poles.rate, poles.residue, inputs)
    resistors = {}
    for shape in shapes:
        resistors[shape.name] = known_resistor(shape.section, str(shape.part), shape.length, shape.width)
    origin = {
        "geometry": shapes[0].section.to_toml(),
        "mesh_accuracy": SECTION * tolerance,
        "resistors": recorded(resistors),
    }
    return ArrayReduction(
        model=replace(model, origin=origin),
        positions=np.array([shape.centre for shape in shapes]),
        error_bound=float(bounds.max()),
        channel_bounds=bounds,
        passive=is_passive(model),
        tolerance=tolerance,
        poles=np.count_nonzero(poles.residue, axis=0),
        outlines=[shape.outlined() for shape in shapes],
    ).recorded()


class Poles(NamedTuple):
    """Shared poles of all channels.

    rate [shape (k,), 1/s]. residue [shape (k, N, inputs), K/W]: R_ijk.
    error [shape (N, inputs)]: largest over the frequencies, relative to a reference.
    """

    rate: Array
    residue: Array
    error: Array


def fitted(H: Complex, omega: Array, slowest: float, reference: Array, tolerance: float) -> Poles:
    """The fewest poles that fit H [shape (frequencies, N, inputs), K/W] at ``omega``, 0 first, or about the best.

    slowest [1/s]: lambda_0. reference [shape (N, inputs), K/W]: of the errors.
    tolerance: of them, of which own rises get `OWN`, others `CROSS`.
    """
    allowed = tolerance * np.where(np.eye(*reference.shape) > 0, OWN, CROSS)
    begin = ABOVE * slowest or ENDLESS
    fits: list[Poles] = []
    excess: list[float] = []
    for ratio in RATIOS:
        count = int(np.log(omega[-1] / begin) / np.log(ratio)) + 2
        rate = np.asarray(slowest + begin * ratio ** np.arange(count), dtype=float)
        poles = _fit(H, omega, rate, reference)
        fits.append(poles)
        excess.append(float((poles.error / allowed).max()))
        if excess[-1] <= 1:
            break
    # 2: where more poles gain less than that, a wide shape has no better fit, and few poles keep a model small
    enough = max(1.0, 2 * min(excess))
    good = [poles for poles, times in zip(fits, excess, strict=True) if times <= enough]
    return next((poles for poles in good if poles.error.max() <= tolerance), good[-1])


def _fit(H: Complex, omega: Array, rate: Array, reference: Array) -> Poles:
    """Least squares over the frequencies, of the own rises with positive residues, made passive."""
    shapes, inputs = reference.shape
    target = (H / reference).reshape(omega.size, -1)
    static = target[0].real
    rows = np.vstack([target.real, target.imag, STIFF * static])
    responses = 1 / (1 + 1j * omega[:, None] / rate)
    columns = np.vstack([responses.real, responses.imag, np.full(rate.size, STIFF)])
    # 1e-4: weight of the residues themselves: neighbouring ones that cancel would cost passivity
    ridge = np.vstack([columns, 1e-4 * np.eye(rate.size)])
    aims = np.vstack([rows, np.zeros((rate.size, reference.size))])
    share, *_ = np.linalg.lstsq(ridge, aims, rcond=None)
    for k in np.arange(shapes) * (inputs + 1):
        # 100: changes of the set of positive residues, per pole: close poles take more than the 3 that SciPy allows
        share[:, k], _ = nnls(columns, rows[:, k], maxiter=100 * rate.size)
    share *= static / share.sum(axis=0)
    residue = share.reshape(-1, shapes, inputs) * reference
    residue[:, :, :shapes] = _passive(residue[:, :, :shapes])
    off = np.tensordot(responses, residue, 1) - H
    error = np.abs(off).max(axis=0) / reference
    return Poles(rate, residue, error)


def _passive(residue: Array) -> Array:
    """Residues whose sums over the fastest poles, however many, have no negative eigenvalue.

    The sum S_m over the poles from m on gets on its diagonal what it, or one over fewer poles, lacks (about 1e-5 of
    R_th). The largest own residue of each shape gives that back: static gains stay, and own residues stay positive.
    """
    sums = np.cumsum(residue[::-1], axis=0)
    least = np.linalg.eigvalsh(sums)[:, 0]
    # 1.001: times a negative eigenvalue, which round-off may not leave below 0
    lack = np.maximum.accumulate(np.maximum(0.0, -1.001 * least))
    more = np.diff(lack, prepend=0.0)[::-1]
    own = np.arange(residue.shape[1])
    largest = residue[:, own, own].argmax(axis=0)
    result = residue.copy()
    result[:, own, own] += more[:, None]
    result[largest, own, own] -= lack[-1]
    return result


def _model(rate: Array, residue: Array, inputs: Sequence[str]) -> StateSpace:
    """The system in which every input drives its own poles, and all shapes read them."""
    drives = np.repeat(np.eye(len(inputs)), rate.size, axis=0)
    reads = np.hstack([by_input.T * rate for by_input in np.moveaxis(residue, 2, 0)])
    outputs = tuple(inputs[: residue.shape[1]])
    return diagonal_system(np.tile(rate, len(inputs)), drives, reads, tuple(inputs), outputs)
