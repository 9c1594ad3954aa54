"""Light, carriers and heat of all rings of a circuit in time."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from thermofem import checks
from thermofem.arrays import Array, ArrayLike

from ..arguments import check_duration, check_times
from ..inputs import Input
from ..kernel.tableaus import Method, tableau
from ..runs.simulate import check_method
from ..runs.window import LONG, MAX_STEPS, check_end
from ..states import check_same_heat
from ..thermal import dense_times, trusted
from .alone import is_alone, run_alone
from .circuit import Circuit
from .drive import corners, warn_of_fast_streams
from .heat import RingHeat
from .network import check_delays
from .record import dataset_of, first_row
from .separate import joined, parts_of, run_parts
from .system import system_of, units_of
from .varying import varies

if TYPE_CHECKING:
    import xarray as xr


def simulate_circuit(
    circuit: Circuit,
    thermal: Any,
    *,
    inputs: Mapping[str, Input],
    heaters: Mapping[str, Any] | None = None,
    detuning: Input = 0.0,
    duration: float = 20e-6,
    rtol: float = 1e-6,
    times: ArrayLike | None = None,
    average: bool = False,
    method: Method | str | None = None,
    initial: xr.Dataset | None = None,
    progress: Callable[[float], None] | None = None,
) -> xr.Dataset:
    """Switch lasers and heaters on at t = 0, on cold, empty rings, and integrate.

        da_i/dt = [i D_i - gamma_i] a_i + i sum_p sqrt(2 gamma_ip) s_in,ip
        s_out,ip = s_in,ip + i sqrt(2 gamma_ip) a_i
        D_i     = -(w_i/n0) [(dn/dT) dT_i + S(N_i)] - 2 pi (reference + offset + detuning - f_i)

    with carriers and absorbed power of each ring as in `simulate`, and dT from all rings and heaters.

    Parameters
    ----------
    circuit : Circuit
    thermal : model with one input and output, or with as many as rings
        one for all rings (no heat between them), or the array reduction of `surrogate.reduce_array`, or its StateSpace.
    inputs : mapping of laser name to float, Waveform, or a list of both; W
        a laser that is left out is dark.
    heaters : mapping of name to float, Waveform, or a list of both; W
        names of the thermal model's further inputs. A number is a power that was on for ever; after another run
        (``initial``) it is on from t = 0.
    detuning : float, Waveform, or a list of both; Hz
        first laser minus its place in the circuit (the reference frequency plus its offset); all lasers move together.
    duration : float, s
    rtol : float
        error allowed in a step of the worst ring, as in `simulate`.
    times : array, s, optional
        wanted output times; by default the accepted steps, which a long run of many rings has no memory for.
    average : bool
        whether ``mean_output``, what every detector shows, averaged from one time to the next, is kept, too.
    method : Method or its name, optional
        default as in `simulate` for one ring on its buses, else Rodas5P, which takes fewer steps behind an edge.
    initial : Dataset, optional
        a run of the same circuit without delays, at whose end this one begins, with the light, carriers and heat that
        it left, that of its heaters too. What drives the circuit begins anew: waveforms, the phases of lasers that
        beat, and detectors with a bandwidth, which are dark.
    progress : callable, optional
        as in `simulate`.

    Returns
    -------
    xarray.Dataset
        over time (s): energy (J), carriers (1/m^3), delta_T (K), absorbed and scattered (W) by ring; output (W) and
        phase (rad) by port; input (W) by laser; heater_power (W) by heater; lost (W) in waveguides and on the way from
        lasers. Where a detector has a bandwidth, detected (W) by port, too: what the detectors show, dark at t = 0. A
        detuning that varies is a variable (Hz), and a constant one an attribute. Light at a jump is that after it.

    Raises
    ------
    InputError
        arguments out of range, names that do not exist, a thermal model for another number of rings, delays too short.

    A circuit of one ring on a bus makes the steps of `simulate`. Rings that share neither light nor heat take steps of
    their own where ``times`` are given. Light without delay obeys at every time

        sum input = sum output + sum (absorbed + scattered) + lost + d(sum energy)/dt

    >>> import coupled, thermofem as th
    >>> model = th.Foster(R=[1998.1, 5786.2], tau=[55.8e-9, 1.2e-6])
    >>> circuit = coupled.bus([coupled.borghi2021()])
    >>> run = coupled.simulate_circuit(circuit, model, inputs={"in": 6.31e-3}, duration=20e-6)
    >>> print(f"{float(run.delta_T.sel(ring='ring 1').max()):.1f} K")
    10.5 K
    """
    from ..kernels import equations as eq
    from ..kernels.interrupts import new_watch, uninterrupted, watched
    from .integrate import integrate
    from .poles import series

    checks.instance("circuit", circuit, Circuit, hint="it must be a Circuit, such as coupled.bus([ring])")
    duration = check_duration(duration)
    rtol = checks.between("rtol", rtol, 1e-13, 1e-1, hint="1e-6 gives traces to better than 1e-5")
    check_delays(circuit)
    duration = float(duration)
    drives: dict[str, Any] = {"inputs": inputs, "heaters": heaters, "detuning": detuning, "duration": duration}
    system = system_of(circuit, thermal, rtol=rtol, before=_heaters_before(initial), **drives)
    light, heat, drive, rings, offsets = system.light, system.heat, system.drive, system.rings, system.offsets
    warn_of_fast_streams(circuit, inputs)
    corner = corners(circuit, light)
    wanted = np.empty(0) if times is None else check_times(times, duration)
    asked, kept = dense_times(thermal, wanted, duration)
    average = checks.flag("average", average)
    alone = is_alone(circuit) and not average and not corner.size and not heat.heaters
    chosen = check_method(method) or (Method.RODAS4 if rtol >= 1e-6 and alone else Method.RODAS5P)
    begin = _start(circuit, heat, initial)
    parts = parts_of(circuit) if wanted.size and not heat.crossed and initial is None else [circuit]
    if len(parts) > 1:
        each = partial(
            simulate_circuit, thermal=thermal, detuning=detuning, duration=duration, rtol=rtol, times=wanted,
            average=average, method=method,
        )  # fmt: skip
        runs = run_parts(parts, inputs, each, progress, duration)
        return joined(circuit, runs).assign_attrs(varies(circuit, system, duration))
    if alone:
        power = inputs.get(circuit.lasers[0].name, 0.0)
        rows, y, counts = run_alone(
            circuit, light, thermal, begin, power=power, detuning=detuning, offset=offsets[0], duration=duration,
            rtol=rtol, method=chosen, times=asked, progress=progress,
        )  # fmt: skip
    else:
        # without a time `integrate` keeps every step; where only t = 0 is wanted, it gets the end, which is dropped
        at_start = bool(asked.size) and not asked.any()
        later = np.array([duration]) if at_start else asked[asked > 0]
        call = partial(watched, progress=(lambda t: progress(t * eq.NS)) if progress else None)
        rows, y, reached, counts = (call if duration > LONG or len(circuit.names) > 4 else uninterrupted)(
            integrate, begin, drive, rings, system.states, system.net, tableau(chosen), series(tableau(chosen)), rtol,
            later / eq.NS, average, corner, MAX_STEPS, new_watch(),
        )  # fmt: skip
        check_end(counts, reached, duration, rtol)
        gathered = rows.shape[1] - 1 - 4 * len(offsets) - 2 * len(light.terminals)
        first = first_row(light, drive, begin, heat, gathered=gathered)
        rows = np.vstack([np.repeat(first[None], int(np.sum(asked <= 0)) if asked.size else 1, axis=0), rows])
        rows = rows[: asked.size] if at_start else rows
        rows[:, 4 : 4 + 4 * len(offsets) : 4] += np.array([offset(rows[:, 0] * eq.NS) for offset in offsets]).T
    if progress:
        progress(duration)
    attributes = {
        "duration": duration, "rtol": float(rtol), "method": chosen.value, "steps": int(counts[0]),
        "rejected_steps": int(counts[1]), "final_state": y * units_of(*heat.gain.shape),
        "model_tau": np.ravel(1 / heat.rate), **varies(circuit, system, duration),
    }  # fmt: skip
    if heat.heaters:
        attributes["heater_states"] = system.heater_states
    trusted(thermal, rows[:, 4 : 4 + 4 * len(offsets) : 4])
    rows = rows[kept] if wanted.size else rows
    return dataset_of(circuit, system, rows, attributes, corner=corner, average=average)


def _heaters_before(initial: xr.Dataset | None) -> Array | None:
    """States of the heaters at the end of another run."""
    if initial is None:
        return None
    kept = getattr(initial, "attrs", {}).get("heater_states", ())
    return checks.array("initial.attrs['heater_states']", np.ravel(kept), empty=True)


def _start(circuit: Circuit, heat: RingHeat, initial: xr.Dataset | None) -> Array:
    """The state that a run begins with, in internal units."""
    n, K = heat.gain.shape
    if initial is None:
        return np.zeros(n * (3 + K))
    if any(w.delay > 0 for w in circuit.waveguides):
        raise checks.InputError("initial: the light on its way through the delays of a circuit is not kept; start cold")
    if "final_state" not in getattr(initial, "attrs", {}):
        raise checks.InputError("initial has no final_state; give a Dataset from coupled.simulate_circuit")
    values = checks.array("initial.attrs['final_state']", initial.attrs["final_state"])
    if values.size != n * (3 + K):
        raise checks.InputError(
            f"initial has {values.size} states and this circuit {n * (3 + K)}; go on with the same circuit and model"
        )
    check_same_heat(initial.attrs.get("model_tau"), 1 / heat.rate)
    return np.asarray(values / units_of(n, K))
