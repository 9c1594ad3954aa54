"""Time traces of a driven ring: energy, carriers, temperature and port powers."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import xarray as xr

from thermofem import InputError, checks, dataset
from thermofem.arrays import Array, ArrayLike
from thermofem.models import ThermalModel

from ..circuit.circuit import Circuit
from ..circuit.system import run_circuit
from ..heater_loop import heater_loop
from ..heaters import Poles, channels, heater_powers, heating, with_ambient
from ..inputs import check_ring, check_run, check_times, detuning_in_time, power_in_time
from ..kernel.tableaus import Method
from ..resistive_heaters import resistive_heaters
from ..resonator import RingResonator
from ..states import State, starting_point
from ..thermal import Heaters, attributes, check_model, dense_times, trusted
from .window import Event, Laser, advance, provenance, traces


def simulate(
    ring: RingResonator | Circuit,
    model: ThermalModel,
    *,
    power: Any,
    detuning: Any = 0.0,
    duration: float = 20e-6,
    rtol: float = 1e-6,
    times: ArrayLike | None = None,
    method: Method | str | None = None,
    initial: State | xr.Dataset | None = None,
    event: Event | None = None,
    heaters: Heaters = None,
    ambient: Any = None,
    heated: str | None = None,
    read: str | None = None,
    lasers: Laser | Sequence[Laser] = (),
    average: bool = False,
    progress: Callable[[float], None] | None = None,
) -> xr.Dataset:
    """Switch the light on at t = 0, on cold, empty rings unless ``initial`` says otherwise, and integrate.

        da/dt   = [i D - gamma] a + i sqrt(2 gamma_e P),     D = -(w0/n0) [(dn/dT) dT + S(N)] - 2 pi detuning
        dN/dt   = -N/tau(N) + g_TPA U^2,                     U = |a|^2
        dx_i/dt = (R_i P_abs - x_i)/tau_i,                   dT = sum_i x_i
        gamma   = gamma_e + gamma_d + gamma_i + gamma_s + eta_FCA N + eta_TPA U
        P_abs   = 2 (gamma_i + eta_FCA N + eta_TPA U) U
        P_drop  = 2 gamma_d U,   P_through = |sqrt(P) + i sqrt(2 gamma_e) a|^2

    and for a circuit, each ring with D, N, P_abs and dT of its own,

        da_i/dt  = [i D_i - gamma_i] a_i + i sum_p sqrt(2 gamma_ip) s_in,ip
        s_out,ip = s_in,ip + i sqrt(2 gamma_ip) a_i

    Parameters
    ----------
    ring : RingResonator or Circuit
    model : ThermalModel
        small: a Foster network, a StateSpace with at most 500 states, an output map over one, or a quadratic model. For
        a circuit one linear model for all rings (no heat between them), or the array reduction of
        `surrogate.reduce_array`, or its StateSpace, with an input and an output for each ring.
    power : float, Waveform (`th.Function` for any function of time), or a list of both; W
        in the bus waveguide; 8 dBm is 6.31e-3. A list adds: a pulse on a bias is
        ``[2e-3, th.Pulse(power=1e-3, width=10e-9, start=5e-6)]``. For a circuit a mapping from the lasers' names; a
        laser that is left out is dark.
    detuning : float, Waveform, or a list of both; Hz
        laser minus cold resonance: positive on the blue side; heat moves the resonance to the red, the negative one.
        ``coupled.Sweep`` is a swept laser. For a circuit laser minus its nominal frequency (the reference frequency
        plus its offset): of all lasers together, or a mapping from their names.
    duration : float, s
    rtol : float
        error allowed in a step relative to field, carriers and temperature.
    times : array, s, optional
        output times, increasing, within the duration; steps between them take no memory. By default the accepted
        steps, which are dense where the traces are steep.
    method : Method or its name, optional
        by default Rodas4 down to rtol = 1e-6 and Rodas5P below, which are the faster ones there.
    initial : State or Dataset, optional
        state at t = 0; of a Dataset, the state at the end of that run, with the heat from its heaters.
        Waveforms and the beat of several lasers start again, and detectors with a bandwidth are dark. Not for circuits
        with delays.
    event : Event, optional
        a level that "energy", "carriers" or "delta_T" rises through: the times are in ``attrs["crossings"]``, and the
        run ends at the first unless ``stop=False``.
    heaters : mapping of name to float, Waveform, or a list of both; W; or to `Volts` or `Amperes`; optional
        power in further inputs of a StateSpace (or of a reduction that holds one), from t = 0 on; for a circuit a
        number is a power that has been on for long, unless the run continues another (``initial``).
        Under a voltage or a current the resistance follows the temperature of the heater (`coupled.Volts`).
    ambient : float, Waveform, `coupled.Sweep`, or a list of them; K, optional
        temperature of the ambient above that of the geometry, from t = 0 on, as of heaters. A model that has the input
        "ambient" (``heat.channels(("core", "ambient"), "core")``) brings it to the ring through the chip; with any
        other one the ring follows it at once, which attrs["ambient"] says.
    heated, read : str, optional
        the input of such a model that the light heats and the output that detunes it; with ``heaters`` by default the
        first input that is no heater, and the temperature that the ring reads, ``ring.read``.
    lasers : Laser or sequence of them, optional
        further lasers: a probe or a second channel on another resonance, or light that beats on the same one. The
        lasers of a circuit are its own.
    average : bool
        for a circuit: whether to return ``mean_output``, the signal of each detector averaged between two times.
    progress : callable, optional
        called with the time in s that has been reached: about ten times a second in long runs, and at
        the end.

    Returns
    -------
    xarray.Dataset
        over time (s): energy (J), carriers (1/m^3), delta_T (K), drop, through and absorbed (W), scattered (W) where
        the ring has such a loss, power and detuning where they vary; heater_power (W) over heater and time, with
        heater_voltage (V) and heater_current (A) where one of them is given; ambient (K) where it moves; with lasers on
        other resonances probe_energy, probe_drop and probe_through over probe and time. Provenance and the
        final state in attrs. Write ``run["drop"]``: ``run.drop`` is a method of every Dataset.
        Of a circuit energy, carriers, delta_T, absorbed and scattered over ring and time; output (W) and phase (rad)
        by port; input (W) by laser; lost (W) in waveguides and on the way from lasers; where a detector has a bandwidth
        detected (W) by port, dark at t = 0. Light at a jump is that after it. Light without delay obeys at every time
        sum input = sum output + sum (absorbed + scattered) + lost + d(sum energy)/dt.

    Raises
    ------
    InputError
        power, detuning, duration, rtol or times out of range, a model that cannot be integrated, an unknown method, a
        waveform that does not cover the run, too many steps; names that a circuit does not have, delays too short.

    Measured at (8 dBm, 0 GHz) over 20 us and 37 pulses, root mean square error of the states in units of their maxima:
    1.4e-5 at rtol = 1e-5 and 9e-7 at 1e-6 (Rodas4), 7e-8 at 1e-8 (Rodas5P).

    Source: Borghi et al., Opt. Express 29, 4363 (2021), Eqs. 2.1-2.5; P_abs without the coupling loss and the ports
    with 2 gamma_e, so that P = P_drop + P_through + P_abs + 2 gamma_s U + dU/dt; symbols as of `RingResonator`.

    >>> import coupled, thermofem as th
    >>> model = th.Foster(R=[1998.1, 5786.2], tau=[55.8e-9, 1.2e-6])
    >>> run = coupled.simulate(coupled.borghi2021(), model, power=6.31e-3, duration=20e-6)
    >>> print(f"{coupled.pulsing(run).period * 1e9:.1f} ns, {coupled.pulsing(run).swing:.2f} K")
    686.0 ns, 5.90 K
    >>> circuit = coupled.bus([coupled.borghi2021()])
    >>> run = coupled.simulate(circuit, model, power={"in": 6.31e-3}, duration=20e-6)
    >>> print(f"{float(run.delta_T.sel(ring='ring 1').max()):.1f} K")
    10.5 K
    """
    duration, rtol = check_run(duration, rtol)
    chosen = None if method is None else Method(str(method).lower())
    wanted = np.empty(0) if times is None else check_times(times, duration)
    drives = with_ambient(heaters, ambient)
    resistive = resistive_heaters(model, drives)
    if resistive:
        alike: dict[str, Any] = {
            "power": power, "detuning": detuning, "duration": duration, "rtol": rtol, "method": method,
            "initial": initial, "event": event, "ambient": ambient, "heated": heated, "read": read, "lasers": lasers,
            "average": average, "progress": progress,
        }  # fmt: skip
        loop = heater_loop(ring, model, resistive, drives, duration, rtol, heated, read, initial)
        return loop.relaxed(partial(simulate, ring, model, **alike), times)[1]
    if isinstance(ring, Circuit):
        alone: dict[str, Any] = {"event": event, "heated": heated, "read": read, "lasers": lasers or None}
        for name, value in alone.items():
            if value is not None:
                raise InputError(f"{name} is for one ring; a circuit has its own lasers, ports and heaters")
        return run_circuit(
            ring, model, power=power, detuning=detuning, heaters=drives, duration=duration, rtol=rtol, times=wanted,
            average=average, method=chosen, initial=initial, progress=progress,
        )  # fmt: skip
    check_ring(ring)
    light = {"input_power": power_in_time(power, duration), "detuning": detuning_in_time(detuning, duration)}
    others = [_checked_laser(laser, duration) for laser in checks.instances("lasers", lasers, Laser)]
    picked = channels(model, ring.read, drives, heated, read)
    small = picked.model
    poles = picked.poles
    doubts = check_model(ring, model, small, read)
    described = attributes(small)
    heat = heating(poles, drives, duration, rtol, before=None)
    if heat.powers and getattr(event, "quantity", "") == "delta_T":
        raise InputError("event watches delta_T without the heaters; with heaters watch 'energy' or 'carriers'")
    begin = starting_point(initial, small.order, described)
    if heat.powers:
        begin = _warmed(begin, poles, heat.begin, -1.0)
    dense, asked = dense_times(model, wanted, duration)
    run = advance(
        ring, small, begin, 0.0, duration, power=light["input_power"], detuning=light["detuning"],
        offset=heat.rises[0] if heat.powers else 0.0, lasers=others, fields=_further_fields(initial), rtol=rtol,
        method=chosen, times=dense, event=event, progress=progress,
    )  # fmt: skip
    trusted(model, run.delta_T)
    end = run.final
    if heat.powers:
        end = _warmed(end, poles, heat.states(run.reached), 1.0)
    gains = {name: each.thermal_resistance for name, each in picked.transfers.items()}
    static = sum(gains.get(name, 1.0) * float(wave(run.reached)) for name, wave in heat.powers.items())
    attrs = {
        **provenance(ring, light, duration),
        **doubts,
        "driven_until": max(run.lights.driven_until, heat.driven_until),
        **described,
        **heat.attributes,
    }
    if initial is not None:
        attrs["initial"] = "given"
    if others:
        resonances = np.array([mode.frequency for mode in run.resonances[1:]])
        attrs |= {"final_fields": run.further, "final_resonances": resonances, "lasers": 1 + len(others)}
    elif static:
        attrs["heater_rise"] = static
    attrs |= {
        "rtol": rtol,
        "method": run.method.value,
        "steps": int(run.counts[0]),
        "rejected_steps": int(run.counts[1]),
        "final_state": end.as_array(),
    }
    if event:
        attrs["crossings"] = run.crossings
    variables = traces(run, light) | heater_powers(heat.powers, run.time)
    variables["time"] = ("time", run.time, dataset.describe("time"))
    result = xr.Dataset(variables, attrs=attrs)
    return result if asked.all() else result.isel(time=asked[: run.time.size])


def _checked_laser(laser: Laser, duration: float) -> Laser:
    power = power_in_time(laser.power, duration)
    return replace(laser, power=power, detuning=detuning_in_time(laser.detuning, duration))


def _warmed(state: State, poles: Mapping[str, Poles], of_heaters: list[Array], sign: float) -> State:
    """Add the rises by heaters (or subtract them) pole by pole, which decay as those by the light do.

    A heater of constant power is then a constant rise from t = 0 on: the poles of the light hold the approach to it.
    of_heaters [J]: states of every heater, as of `Heating`.
    """
    rises = [each.gain[0] * x for each, x in zip(poles.values(), of_heaters, strict=True)]
    return replace(state, thermal=np.asarray(state.thermal) + sign * sum(rises))


def _further_fields(initial: State | xr.Dataset | None) -> dict[float, Array]:
    """Return Re and Im (sqrt(J)) of the other resonances' fields at the end of a run, by resonance frequency in Hz.

    `advance` leaves out a resonance that no laser drives any more: its light decays within some photon lifetimes.
    """
    attrs = getattr(initial, "attrs", {})
    if "final_fields" not in attrs:
        return {}
    fields = checks.array("initial.attrs['final_fields']", np.ravel(attrs["final_fields"]), empty=True)
    places = np.ravel(attrs.get("final_resonances", ()))
    places = checks.array("initial.attrs['final_resonances']", places, empty=True)
    checks.shape("initial.attrs['final_fields']", fields, (2 * places.size,))
    return dict(zip(places.tolist(), fields.reshape(-1, 2), strict=True))
