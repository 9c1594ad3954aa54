"""A whole ring, and a heater with a Foster network, as components of circulax (JAX; Python 3.12, circulax 0.2.5).

A component is a function of its signals that returns f and q with f + dq/dt = 0, a row for each port and state. The
numbers of light and carriers come from `coupled.export.ring_ports`, in ns, fJ and 1e23/m^3.
Prints the period of the ring at 8 dBm and 0 GHz, and the phase of a heater against its step response.
"""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
from circulax.compiler import compile_netlist
from circulax.components.base_component import component, source
from circulax.solvers import analyze_circuit, setup_transient
from circulax.solvers.transient import BDF2VectorizedTransientSolver

import coupled
import surrogate
from coupled.export.ring_ports import ring_ports

jax.config.update("jax_enable_x64", True)


def ring_component(ring, model):
    """The ring with the poles of a Foster network; fields in sqrt(W), detuning in GHz."""
    ports = ring_ports(ring)
    r = ports.rates
    R = model.R
    tau = model.tau * 1e9
    poles = tuple(f"x{k}" for k in range(len(R)))
    states = ("a_re", "a_im", "n", "o_re", "o_im", *poles)

    @component(ports=("in_re", "in_im", "drop_re", "drop_im", "detuning"), states=states)
    def Ring(signals):
        s = signals
        x = jnp.stack([getattr(s, name) for name in poles])
        u = s.a_re**2 + s.a_im**2
        shift = sum(c * s.n * (s.n**2 + 1e-12) ** ((p - 1) / 2) for c, p in ports.dispersion)
        d = -r.thermal_shift * x.sum() - shift - r.kerr * u - 2 * jnp.pi * s.detuning
        g = r.fca * s.n + r.tpa * u
        heat = 2e-6 * (r.absorbed + g) * u
        f = {"in_re": 0.0, "in_im": 0.0, "detuning": 0.0, "drop_re": s.o_re, "drop_im": s.o_im}
        f |= {"o_re": s.drop_re + ports.drop * s.a_im, "o_im": s.drop_im - ports.drop * s.a_re}
        f["a_re"] = (r.loss + g) * s.a_re + d * s.a_im + ports.pump * s.in_im
        f["a_im"] = (r.loss + g) * s.a_im - d * s.a_re - ports.pump * s.in_re
        f["n"] = s.n * (1 + r.b * s.n) / (r.tau0 * (1 + r.a * s.n)) - r.g * u**2
        f |= {name: (x[k] - R[k] * heat) / tau[k] for k, name in enumerate(poles)}
        return f, {name: 1e-9 * getattr(s, name) for name in ("a_re", "a_im", "n", *poles)}

    return Ring


def heater_component(model, resistance, phase_per_kelvin):
    """A thermal phase shifter: voltage v on a resistance in ohm; its phase in rad is the voltage at the port."""
    R, tau = model.R, model.tau * 1e9
    poles = tuple(f"x{k}" for k in range(len(R)))

    @component(ports=("v", "phase"), states=("i", *poles))
    def Heater(signals):
        s = signals
        x = jnp.stack([getattr(s, name) for name in poles])
        f = {"v": s.v / resistance, "phase": s.i, "i": s.phase - phase_per_kelvin * x.sum()}
        f |= {name: (x[k] - R[k] * s.v**2 / resistance) / tau[k] for k, name in enumerate(poles)}
        return f, {name: 1e-9 * getattr(s, name) for name in poles}

    return Heater


@source(ports=("p1", "p2"), states=("i",))
def Step(signals, t, V: float = 0.0):
    """A voltage that rises from 0 to V within 0.1 ns: fixed steps do not see a jump."""
    s = signals
    return {"p1": s.i, "p2": -s.i, "i": s.p1 - s.p2 - V * jnp.clip(t / 1e-10, 0.0, 1.0)}, {}


def run(part, inputs, outputs, times, step):
    """Outputs of one component, one row each, whose inputs are switched on at t = 0; BDF2 with fixed steps, in s."""
    instances = {"GND": {"component": "ground"}, "part": {"component": "part"}}
    instances |= {name: {"component": "step", "settings": {"V": value}} for name, value in inputs.items()}
    wires = {"GND,p1": tuple(f"{name},p2" for name in inputs)}
    wires |= {f"{name},p1": f"part,{name}" for name in inputs} | {f"part,{name}": f"part,{name}" for name in outputs}
    net = {"instances": instances, "connections": wires, "ports": {name: f"part,{name}" for name in outputs}}
    groups, size, places = compile_netlist(net, {"part": part, "step": Step, "ground": lambda: 0})
    solver = analyze_circuit(groups, size, backend="dense")
    solve = setup_transient(groups, solver, transient_solver=BDF2VectorizedTransientSolver)
    saved = diffrax.SaveAt(ts=jnp.asarray(times))
    found = solve(t0=0.0, t1=times[-1], dt0=step, y0=jnp.zeros(size), saveat=saved, max_steps=4_000_000)
    return [np.asarray(found.ys)[:, places[f"part,{name}"]] for name in outputs]


def period_of(ring, model, power, duration, step=0.5e-9):
    """Mean of the last eight periods of the drop power, in s."""
    times = np.arange(0.0, duration, 1e-9)
    inputs = {"in_re": float(np.sqrt(power)), "in_im": 0.0, "detuning": 0.0}
    re, im = run(ring_component(ring, model), inputs, ("drop_re", "drop_im"), times, step)
    drop = re**2 + im**2
    middle = (drop[times > duration / 2].min() + drop[times > duration / 2].max()) / 2
    k = np.flatnonzero((drop[:-1] < middle) & (drop[1:] >= middle))
    rises = times[k] + (middle - drop[k]) / (drop[k + 1] - drop[k]) * 1e-9
    return np.diff(rises)[-8:].mean()


if __name__ == "__main__":
    law = surrogate.second_order(kappa=8.87e5, tau_f=55.8e-9, tau_s=1200e-9, eta=0.31)
    power = 10**0.8 * 1e-3
    settled = float(coupled.limit_cycle(coupled.borghi2021(), law, power=power, detuning=0.0).attrs["period"])
    period = period_of(coupled.borghi2021(), law, power, duration=20e-6)
    print(f"period {1e9 * period:.3f} ns, limit cycle {1e9 * settled:.3f} ns: {100 * (period / settled - 1):+.4f} %")

    times = np.arange(0.0, 5e-6, 10e-9)
    (phase,) = run(heater_component(law, 500.0, 1e-2), {"v": 1.0}, ("phase",), times, 1e-9)
    exact = 1e-2 * law.step_response(times) / 500.0
    print(f"heater: largest error of the phase {np.abs(phase - exact).max() / exact.max():.1e} of its end value")
