"""Fit of slow sweeps of a laser through a resonance, hysteresis included, by the curve of all fixed points."""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass

import numpy as np
import xarray as xr

from thermofem import Foster
from thermofem.arrays import Array
from thermofem.data import dataset
from thermofem.models import HasModel, ThermalModel
from thermofem.models.foster import second_order_poles

from ..heaters import warmed
from ..identification.box_search import End
from ..identification.deviations import unknown_as_inf
from ..identification.held_numbers import HELD_STEP, held_deviations, held_numbers, summary
from ..inputs import check_ring, datasets, noises
from ..parameters import SECOND_ORDER_FEM
from ..resonator import RingResonator
from ..thermal import notes_of
from ..unknowns import with_equal_buses
from .slow_sweeps import Sweep, read_sweep
from .sweep_doubts import correlation_of, doubts_of, level_doubts, widening_by, with_other_answer
from .transmission_search import FREQUENCY, POWER, RESISTANCE, Search, make_search, searched, sweep_residuals

log = logging.getLogger("thermofem")

DERIVED = ("loaded_q", "intrinsic_q", "heating")
BLIND, OPEN = 1e-3, 0.05  # of the largest slope: none; share of a number along such directions that leaves it open
SLOPE_STEP = 1e-5  # of an unknown, for the slopes of derived quantities


@dataclass(frozen=True, eq=False, repr=False)
class TransmissionFit(HasModel):
    """Result of `fit_transmission`. ``print`` shows it in a dozen lines.

    Attributes
    ----------
    parameters, standard_deviations : dict of str to float
        of the free parameters, in SI, and of three derived ones: "loaded_q", "intrinsic_q" and "heating" (K/W), R_th
        times the absorbed fraction of the intrinsic loss. A deviation is inf for a parameter not determined.
    ring, model : RingResonator, Foster
        with those parameters; of the model only R_th is meaningful, not its time constant.
    misfit : float
        root mean square of the residuals, about 1 where noise and step size explain them.
    curves : list of xarray.Dataset
        the fitted curve of fixed points for each sweep, as `transmission` returns it, and "signal", that curve in the
        unit of the sweep with its baseline.
    samples : list of xarray.Dataset
        each sweep over step: power (W) or detuning (Hz, from the fitted resonance), "signal" as measured, and
        "residual"; in attrs "offset" and "slope" of its baseline, the slope from one end of the sweep to the other.
    sensitivities : dict of str to dict of str to float
        of each parameter to each number that was held, d ln parameter/d ln held: 0.5 says that the parameter moves by
        0.5 % for 1 % of the held number. Of "frequency", in linewidths.
    alternative : dict of str to float, or None
        the free parameters of the second answer of a through port, where it fits as well: bus and loss exchanged.
    notes : tuple of str
        reasons for which the result is doubtful.
    """

    parameters: dict[str, float]
    standard_deviations: dict[str, float]
    ring: RingResonator
    model: Foster
    misfit: float
    curves: list[xr.Dataset]
    samples: list[xr.Dataset]
    sensitivities: dict[str, dict[str, float]]
    alternative: dict[str, float] | None = None
    notes: tuple[str, ...] = ()

    def __repr__(self) -> str:
        """The parameters with their deviations, what they lean on, and the notes: a line each."""
        samples = sum(sweep.sizes["step"] for sweep in self.samples)
        title = f"TransmissionFit of {len(self.samples)} sweeps, {samples} samples: misfit {self.misfit:.3g}"
        return summary(title, self.parameters, self.standard_deviations, self.sensitivities, self.notes)


def fit_transmission(
    ring: RingResonator,
    sweeps: xr.Dataset | Sequence[xr.Dataset],
    *,
    free: Sequence[str],
    model: ThermalModel | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    noise: float | Sequence[float] | None = None,
    held: Mapping[str, float] | None = None,
) -> TransmissionFit:
    """Fit parameters of a ring to slow sweeps: its steady transmission is compared with all of them at once.

    Each sweep of the wavelength has a baseline, an offset and a slope, as linear unknowns beside the parameters
    (`slow_sweeps`): dark level, level of a fibre, tilt of grating couplers. The residuals are distances from the
    curve of all fixed points (`sweep_residuals`).

    Parameters
    ----------
    ring : RingResonator
        start values of the free parameters, and values of the others.
    sweeps : xarray.Dataset or sequence of them
        drop or through over one dimension, in W (mW, ..), in "1" or "%" of the bus power, in "dB" or "dBm", or in an
        arbitrary unit such as V; with power (W), and wavelength (m) or detuning (Hz, from the ring's frequency), one of
        them swept along the dimension, the other constant. Upward, downward or both. The scale of an arbitrary unit, of
        dB and of dBm (losses of fibres) is fitted: for each sweep of a through port, for all of a drop port.
    free : sequence of str
        fields of the ring or its carriers ("frequency", "bus_rate", "loss_rate", "scattering_rate", ..), "lifetime" (s,
        of the carriers), "loaded_q" (sets the rates into the buses), "intrinsic_q" (sets the losses),
        "thermal_resistance" (K/W), and "power", a common factor of all powers, such as a fibre coupling loss.
    model : ThermalModel, optional
        source of the thermal resistance, or of its start value; by default the paper's.
    bounds : mapping of name to (low, high), optional
        by default a factor of 4 either side of the start; of "frequency" the range of the sweeps (Hz).
    noise : float or sequence of float, optional
        standard deviation of a sample in the unit of its sweep (in dB: relative noise), one for all or one for each; by
        default estimated from each sweep. Noise of a sweep in dB counts as constant in dB.
    held : mapping of name to float, optional
        standard deviations (SI) of numbers that are held, fields of the ring, "thermal_resistance" or "power"; the
        deviations of the result then contain them.

    Returns
    -------
    TransmissionFit

    Raises
    ------
    InputError
        a name, bound, deviation or sweep that cannot be used; powers below zero in a unit that is not decibels.

    Without two-photon absorption the sweeps determine only "heating", the product of R_th and the absorbed fraction of
    the loss, and not the two factors; and a through port alone does not tell the bus from the loss: both answers are
    tried, and named where both fit (`sweep_doubts`).

    >>> import coupled, thermofem as th
    >>> ring, heat = coupled.borghi2021(), th.Foster(R=[9e3], tau=[1e-6])
    >>> seen = [coupled.transmission(ring, heat, power=p, detuning=(-50e9, 30e9)) for p in (1e-4, 3e-3)]
    >>> seen = [sweep.drop_vars("through") for sweep in seen]
    >>> found = coupled.fit_transmission(ring, seen, free=["thermal_resistance"])
    >>> print(f"{found.parameters['thermal_resistance']:.0f} K/W")
    9000 K/W
    """
    check_ring(ring)
    ring = with_equal_buses(ring, free)
    given = datasets("sweeps", sweeps)
    sizes = noises(noise, len(given))
    data = []
    for k, (sweep, size) in enumerate(zip(given, sizes, strict=True)):
        data.append(read_sweep(f"sweeps[{k}]", sweep, ring, size))
    law = second_order_poles(**asdict(SECOND_ORDER_FEM)) if model is None else model
    heat = warmed(ring, law)
    search = make_search(ring, float(heat.model.thermal_resistance), data, free, bounds)
    values = held_numbers(ring, free) | {RESISTANCE: search.resistance, POWER: 1.0, FREQUENCY: ring.frequency}
    values = {name: value for name, value in values.items() if name not in free}
    deviations = held_deviations(held, [*values], free)
    search, end, other = with_other_answer(search, searched(search, search.start), bounds)
    return _result(search, end, other, values, deviations, notes_of(heat.doubts))


def _result(
    search: Search, end: End, other: dict[str, float] | None, held_values: Mapping[str, float],
    held: Mapping[str, float], contradicted: tuple[str, ...],
) -> TransmissionFit:  # fmt: skip
    """Parameters with standard deviations, derived quantities, curves and notes, as a TransmissionFit."""
    ring, heat, _ = search.build(end.x)
    curves = []
    samples = []
    unknowns = end.x.size
    for sweep, line, curve in zip(search.data, search.lines(end.x), search.curves(end.x), strict=True):
        residual, a = sweep_residuals(sweep, line.x, line.output)
        signal = line.output + a @ sweep.baseline_terms(line.x, line.output)
        curves.append(curve.assign(signal=("point", *_as_measured(sweep, signal))))
        samples.append(_samples(sweep, residual, a, ring.frequency - search.reference))
        unknowns += a.size
    misfit = float(np.sqrt(end.cost / max(end.r.size - unknowns, 1)))
    correlations = [correlation_of(sample["residual"].values) for sample in samples]
    widening = max(misfit, 1.0) * widening_by(max(correlations))
    relative, sensitivities = _spread(search, end, widening, held_values, held)
    derived = dict(zip(DERIVED, np.exp(_derived(search, end.x)).tolist(), strict=True))
    every = search.values(end.x) | derived
    deviations = {}
    for name, s in zip((*search.names, *DERIVED), relative, strict=True):
        value = every[name]
        size = search.linewidth if name == FREQUENCY else value
        deviations[name] = float(unknown_as_inf(s) * size)
    notes = [*level_doubts(samples), *doubts_of(search, end, deviations, misfit, correlations, other)]
    for note in notes:
        log.warning("%s", note)
    return TransmissionFit(
        every, deviations, ring, heat, misfit, curves, samples, sensitivities, other,
        (*contradicted, *notes),
    )  # fmt: skip


def _derived(search: Search, x: Array) -> Array:
    """Logarithms of loaded Q, intrinsic Q and heating (K/W) at the unknowns ``x``."""
    ring, heat, _ = search.build(x)
    own = ring.loss_rate + ring.scattering_rate
    heating = heat.thermal_resistance * ring.loss_rate / own if own else 0.0
    return np.log([ring.loaded_q, ring.intrinsic_q, max(heating, 1e-300)])


def _spread(
    search: Search, end: End, widening: float, held_values: Mapping[str, float], held: Mapping[str, float]
) -> tuple[Array, dict[str, dict[str, float]]]:
    """Deviations of all parameters from the Jacobian, widened, and from the deviations of held numbers.

    Returns those of the logarithms (of "frequency": in linewidths), inf where the sweeps do not determine one, and the
    sensitivities to each held number by parameter.
    """
    _, size, V = np.linalg.svd(end.J, full_matrices=False)
    visible = size > BLIND * size[0]
    slopes = []
    for unit in np.eye(end.x.size):
        above = _derived(search, end.x + SLOPE_STEP * unit)
        below = _derived(search, end.x - SLOPE_STEP * unit)
        slopes.append((above - below) / (2 * SLOPE_STEP))
    own = np.eye(end.x.size)[: len(search.names)]
    along = np.vstack([own, np.transpose(slopes)]) @ V.T
    variance = (along[:, visible] ** 2 / size[visible] ** 2).sum(axis=1) * widening**2
    unseen = np.linalg.norm(along[:, ~visible], axis=1) > OPEN * np.linalg.norm(along, axis=1)
    names = [*search.names, *DERIVED]
    sensitivities: dict[str, dict[str, float]] = {name: {} for name in names}
    for held_name, value in held_values.items():
        is_frequency = held_name == FREQUENCY
        scale = search.linewidth if is_frequency else value
        moves = _moved(search, end, held_name, value, HELD_STEP * scale, V[visible])
        variance = variance + (moves * held.get(held_name, 0.0) / scale) ** 2
        for name, slope in zip(names, moves, strict=True):
            if not is_frequency:
                sensitivities[name][held_name] = float(slope)
    relative = np.sqrt(variance)
    relative[unseen] = np.inf
    for name, blind in zip(names, unseen, strict=True):
        if blind:
            sensitivities.pop(name)
    return relative, sensitivities


def _moved(search: Search, end: End, name: str, value: float, step: float, V: Array) -> Array:
    """Derivative of all parameters (logarithms) by a held number in units of ``step``/`HELD_STEP`, at the minimum.

    V: right singular vectors of the Jacobian along which the sweeps determine the parameters, as rows.
    """
    changed = search.with_held(name, value + step)
    change = (changed.residuals(end.x) - end.r) / HELD_STEP
    along = np.linalg.lstsq(end.J @ V.T, change, rcond=None)[0]
    x_slope = -V.T @ along
    moved_x = end.x + HELD_STEP * x_slope
    derived_slope = (_derived(changed, moved_x) - _derived(search, end.x)) / HELD_STEP
    return np.concatenate([x_slope[: len(search.names)], derived_slope])


def _as_measured(sweep: Sweep, y: Array) -> tuple[Array, dict[str, str]]:
    """A signal in the unit of the sweep, as it was measured, and its attributes."""
    signal = y + sweep.level if sweep.free_level and sweep.decibels else y * sweep.level
    return signal, {"units": sweep.unit, "long_name": f"{sweep.port} signal"}


def _samples(sweep: Sweep, residual: Array, a: Array, shift: float) -> xr.Dataset:
    """A sweep as a Dataset over step; ``shift`` [Hz]: of the fitted resonance from the initial one."""
    found = xr.Dataset(
        {
            "signal": ("step", *_as_measured(sweep, sweep.y)),
            "residual": ("step", residual, {"units": "1", "long_name": "distance over noise and step"}),
        },
        attrs={"port": sweep.port},
    )
    if sweep.power is None:
        found["power"] = ("step", np.exp(sweep.x), dataset.describe("input_power"))
        return found.assign_attrs(detuning=sweep.detuning)
    found["detuning"] = ("step", sweep.x - shift, dataset.describe("detuning"))
    sizes = a * sweep.baseline_scales
    offset = float(sizes[0]) if sizes.size == 2 else 0.0
    return found.assign_attrs(power=sweep.power, offset=offset, slope=2 * float(sizes[-1]))
