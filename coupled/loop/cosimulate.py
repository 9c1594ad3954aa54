"""FEM in the loop: light and carriers coupled to the full-order heat problem, or to any other corrector."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from thermofem import Foster, Function, InputError, OutputMap, StateSpace, checks
from thermofem.algebra.krylov import krylov
from thermofem.arrays import Array, ArrayLike
from thermofem.fem import HeatProblem
from thermofem.models import NonlinearSystem, ThermalModel
from thermofem.ring_temperature import detuning_output
from thermofem.waveforms import KINDS, PiecewiseCubic, Waveform

from ..heater_loop import HeaterLoop, difference, heater_loop
from ..heaters import heater_powers
from ..inputs import (
    Lights,
    Pieces,
    check_ring,
    check_run,
    check_times,
    detuning_in_time,
    last_change,
    pieces,
    power_in_time,
)
from ..resistive_heaters import drive_in_time, resistive_heaters
from ..resonator import RingResonator
from ..runs.simulate import simulate
from ..runs.window import Laser, Window, lights_of, provenance, traces
from ..states import State
from ..thermal import check_geometry, check_model, compact, plain
from .corrector import FEM, Corrector, beginning, end_of_run
from .relaxation import Passed, Relaxation

if TYPE_CHECKING:
    import xarray as xr


NO_PREDICTOR = OutputMap(Foster(R=[0.0], tau=[1e-6]), 0.0)
"""A predictor of zero temperature rise: the fed-back discrepancy is the whole temperature."""

FIRST = 0.25e-6  # s, about the first window


def cosimulate(
    ring: RingResonator,
    heat: HeatProblem | StateSpace | NonlinearSystem | Corrector,
    *,
    power: Any,
    detuning: Any = 0.0,
    duration: float = 20e-6,
    predictor: ThermalModel | None = None,
    max_discrepancy: float = 1e-3,
    rtol: float = 1e-6,
    heaters: Mapping[str, Waveform] | None = None,
    field_times: ArrayLike = (),
    initial: xr.Dataset | None = None,
    progress: Callable[[float], None] | None = None,
) -> xr.Dataset:
    """Integrate a ring together with the full-order heat problem, cold and empty unless ``initial`` says otherwise.

    The equations are those of `simulate`; the thermal model only predicts. In each time window (`relaxation`) the
    corrector receives the absorbed power and returns the temperature. The difference from the predicted temperature is
    fed back, and the window is repeated until the difference is below ``max_discrepancy``. The FEM's temperature is
    then updated for the changed light, so that the times of the pulses converge, too.

    Parameters
    ----------
    ring : RingResonator
    heat : HeatProblem, StateSpace, NonlinearSystem or Corrector
        the FEM, linear or with k(T) and c_p(T); matrices, also of another program; or an object that satisfies the
        contract in `coupled.loop.corrector`.
    power, detuning, duration : W, Hz, s
        as in `simulate`: numbers or waveforms.
    predictor : ThermalModel, optional
        any model that `simulate` takes; it changes the work, not the result. A StateSpace may have the heaters as
        further inputs. Default: for a HeatProblem a Krylov reduction of it, otherwise `NO_PREDICTOR`.
    max_discrepancy : float, K
        largest difference left between the temperature that the light sees and the corrector's.
    rtol : float
        of light and carriers, as in `simulate`.
    heaters : mapping of name to float, Waveform, `Volts` or `Amperes`, optional
        power in W of other heated parts of a HeatProblem, or their voltage or current.
    field_times : array, s, optional
        times at which the temperature field of a HeatProblem is stored.
    initial : Dataset, optional
        initial state: the end of another co-simulation of the same ``heat``, or a cycle of `limit_cycle` with a
        reduction of it, for which the periodic field on the mesh is computed; it settles within a period or two.
    progress : callable, optional
        called with the simulated time in s after every window.

    Returns
    -------
    xarray.Dataset
        as of `simulate`, delta_T being the corrector's; passes and discrepancy (K) over window (its start in s); field
        over field_time and vertex where ``field_times`` asks for it. In attrs: passes, largest_discrepancy (K),
        estimated_change (K, change by one more pass within a window), counts of the FEM (fem_steps,
        fem_solves, fem_factorizations), its heat balance (J), and the CPU time of both sides.

    Raises
    ------
    InputError
        an argument out of range, a predictor that cannot be integrated, a relaxation that does not converge in any
        window, with the reason.

    Source: Borghi et al., Opt. Express 29, 4363 (2021), Section 7, where this is left open.

    >>> import coupled, thermofem as th
    >>> heat = th.assemble(th.strip_ring())
    >>> run = coupled.cosimulate(coupled.borghi2021(), heat, power=6.31e-3, duration=20e-6)
    >>> last = coupled.pulsing(run)  # of 20 us from cold; `initial` begins on the settled cycle, 684.9 ns
    >>> print(f"{last.period * 1e9:.0f} ns, {last.swing:.2f} K")
    680 ns, 5.87 K
    """
    check_ring(ring)
    duration, rtol = check_run(duration, rtol)
    electric = None
    max_discrepancy = checks.between(
        "max_discrepancy", max_discrepancy, 1e-8, 1, unit="K", hint="1e-3 K gives periods to about 1e-4"
    )
    light = {"input_power": power_in_time(power, duration), "detuning": detuning_in_time(detuning, duration)}
    field_moments = checks.array("field_times", field_times, increasing=True, empty=True)
    if field_moments.size:
        check_times(field_moments, duration, "field_times")
    if isinstance(heat, HeatProblem | StateSpace | NonlinearSystem):
        drives = checks.mapping("heaters", heaters, hint="e.g. {'heater': 5e-3}")
        read = _read_output(ring, heat)
        drive = {"power": power, "detuning": detuning, "duration": duration, "rtol": rtol}
        electric = _electric(ring, heat, drives, initial, read, drive)
        powers = drives if electric is None else electric[0].inputs(electric[1])
        drives = {name: _over(name, power, duration) for name, power in powers.items()}
        corrector: Any = FEM(
            heat, read=read, heaters=drives, max_discrepancy=max_discrepancy, field_times=field_moments
        )  # fmt: skip
    elif heaters or np.size(field_times):
        raise InputError("heaters and field_times go with a HeatProblem; a corrector takes care of its own")
    elif isinstance(heat, type) or not all(callable(getattr(heat, name, None)) for name in ("advance", "accept")):
        raise InputError(
            f"heat is a {type(heat).__name__}; give th.assemble(geometry), or an object with advance() and accept() "
            "(coupled.loop.corrector.Corrector)"
        )
    else:
        corrector = heat
    fem_given = isinstance(corrector, FEM)
    doubts = check_model(ring, corrector.problem or heat, corrector.linear) if fem_given else check_geometry(ring, heat)
    chosen = getattr(corrector, "predictor", NO_PREDICTOR) if predictor is None else predictor
    if isinstance(chosen, StateSpace) and fem_given:
        output = detuning_output(ring.read, corrector.heated, tuple(chosen.outputs))
        chosen = chosen.channel(corrector.heated, output)
    model = NO_PREDICTOR if chosen is NO_PREDICTOR else compact(chosen)
    begin = beginning(initial, corrector, model)
    rise = corrector.rise if fem_given else 0.0
    level = round(np.log2(max(duration / FIRST, 1.0)))
    loop = Relaxation(
        ring, model, corrector, light["input_power"], light["detuning"], float(duration), level, max_discrepancy, rtol,
        begin, _background(corrector, predictor), accepted=rise,
        rest=rise - float(model.read(np.asarray(begin.thermal))),
    )  # fmt: skip
    parts = []
    while loop.time < duration:
        parts.append(loop.advance())
        if progress:
            progress(loop.time)
    data = _dataset(ring, light, loop, parts, duration).assign_attrs(doubts)
    if electric is not None:
        heater_feedback, watts = electric
        change = difference(heater_feedback.powers(data), watts)
        data = heater_feedback.described(data).assign_attrs(heater_change=change)
    return data if initial is None else data.assign_attrs(initial="given")


def _read_output(ring: RingResonator, heat: HeatProblem | StateSpace | NonlinearSystem) -> str:
    """Name of the output of the FEM that a ring reads."""
    system = heat.system if isinstance(heat, HeatProblem) else heat
    return detuning_output(ring.read, system.inputs[0], tuple(system.outputs))


def _electric(
    ring: RingResonator, heat: Any, heaters: Any, initial: Any, read: str, drive: dict[str, Any]
) -> tuple[HeaterLoop, dict[str, Pieces]] | None:
    """The loop and the powers of heaters under a voltage or a current; None without such heaters.

    With a tcr the powers are those of runs of `simulate` with a reduction of the FEM.
    Raises InputError: a tcr of matrices without geometry, with k(T) or from a cycle.
    """
    resistive = resistive_heaters(heat, heaters)
    if not resistive:
        return None
    if not any(one.resistor.tcr for one in resistive):
        loop = heater_loop(ring, heat, resistive, heaters, drive["duration"], drive["rtol"])
        return loop, loop.powers()
    from_run = initial is None or "final_rise" in initial
    if not isinstance(heat, HeatProblem) or heat.nonlinear or not from_run:
        rule = "heaters with a tcr need a HeatProblem with constant k and c_p, from cold or from the end of a run"
        raise InputError(rule, "give tcr = 0, or their power in W")
    parts = (heat.heated[0], *heaters)
    system = heat.channels(parts, tuple(dict.fromkeys((read, *heaters))))
    basis = krylov(system)
    small = basis.reduced(system)
    start = None
    if initial is not None:
        light, field = end_of_run(initial, heat, system.order)
        modes = basis.vectors.T @ (system.E @ field)
        rises = small.C[0] * modes
        start = State.from_array(np.append(light, rises[np.argsort(1 / basis.rate)]))
    loop = heater_loop(ring, small, resistive, heaters, drive["duration"], drive["rtol"], initial=start)
    watts, _ = loop.relaxed(partial(simulate, ring, small, initial=start, **drive))
    return loop, watts


def _over(name: str, value: Any, duration: float) -> Any:
    """Return the checked power of a heater: a waveform as it is; a number, function or list as a piecewise cubic."""
    power = drive_in_time(name, value, duration)
    if type(value).__name__ in KINDS and not isinstance(value, Function):
        return value
    return PiecewiseCubic(power.edges, power.coefficients)


def _background(corrector: Any, predictor: ThermalModel | None) -> Callable[[Array], Array] | None:
    """Return a function of time (s): the rise in K by the heaters. None without heaters or without the FEM."""
    if not isinstance(corrector, FEM) or not corrector.heaters:
        return None
    own = corrector.basis.reduced(corrector.linear)
    reduced = predictor if isinstance(predictor, StateSpace) else own
    names = [name for name in corrector.heaters if name in reduced.inputs]
    channels = {name: reduced.channel(name, corrector.read).dynamics for name in names}

    def rise(times: Array) -> Array:
        responses = [channel.response(corrector.heaters[name], times) for name, channel in channels.items()]
        return np.sum(responses, axis=0) + np.zeros(times.size)

    return rise


def _dataset(
    ring: RingResonator, light: dict[str, Any], loop: Relaxation, parts: list[Passed], duration: float
) -> xr.Dataset:
    import xarray as xr

    from thermofem.data import dataset
    from thermofem.solving import fields

    laser = Laser(light["input_power"], light["detuning"])
    run = _joined(parts, lights_of(ring, [laser], 0.0, float(duration)))
    fem = loop.corrector
    heaters = getattr(fem, "heaters", {})
    changes = [last_change(pieces("heaters", wave, 0.0, duration)) for wave in heaters.values()]
    predictor = "none"
    if loop.model is not NO_PREDICTOR:
        predictor = f"{type(plain(loop.model)).__name__} with {loop.model.order} states"
    counts = {"units": "1", "long_name": "passes of the window"}
    kelvin = {"units": "K", "long_name": "largest discrepancy of the temperature"}
    starts = np.array([part.run.time[0] for part in parts])
    data = xr.Dataset(
        {
            **traces(run, light),
            "passes": ("window", [part.passes for part in parts], counts),
            "discrepancy": ("window", [part.discrepancy for part in parts], kelvin),
            **heater_powers(heaters, run.time),
        },
        coords={
            "time": ("time", run.time, dataset.describe("time")),
            "window": ("window", starts, {"units": "s", "long_name": "start of the window"}),
        },
        attrs={
            **provenance(ring, light, duration),
            "driven_until": max([run.lights.driven_until, *changes]),
            "rtol": loop.rtol,
            "max_discrepancy": loop.max_discrepancy,
            "predictor": predictor,
            "steps": int(run.counts[0]),
            "windows": len(parts),
            "windows_abandoned": loop.abandoned,
            "passes": loop.passes,
            "largest_discrepancy": max(part.discrepancy for part in parts),
            "estimated_change": max(part.moved for part in parts),
            "cpu_optics": loop.seconds["optics"],
            "cpu_corrector": loop.seconds["corrector"],
        },
    )
    data.attrs = dict(getattr(fem, "summary", dict)()) | data.attrs
    if not isinstance(fem, FEM):
        return data
    data.attrs["final_light"] = loop.state.as_array()[:3]
    about = {"units": "K", "long_name": "rise of every unknown at the end"}
    data["final_rise"] = ("unknown", fem.field.temperature(fem.state), about)
    if fem.problem and fem.field_times.size:
        history = fields(fem.problem, np.array(fem.fields), fem.field_times)
        data = data.merge(history, combine_attrs="override")
    return data


def _joined(parts: list[Passed], lights: Lights) -> Window:
    """Concatenate all windows, with the corrector's temperature; end points that two windows share appear once."""

    def together(arrays: list[Any]) -> Any:
        first, *later = arrays
        return np.concatenate([first, *(array[..., 1:] for array in later)], axis=-1)

    rise = together([part.delta_T for part in parts])
    names = ("time", "fields", "carriers", "absorbed", "absorbed_slope")
    joined = {name: together([getattr(part.run, name) for part in parts]) for name in names}
    counts = np.sum([part.run.counts for part in parts], axis=0)
    return parts[-1].run._replace(**joined, delta_T=rise, counts=counts, lights=lights)
