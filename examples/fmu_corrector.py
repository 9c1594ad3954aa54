"""A co-simulation unit (FMI 2.0) as the corrector, in a process of its own: whatever exports an FMU can be in the loop.

Any program's unit will do that takes a power in W and gives a temperature rise in K; here it is the reduced finite
elements, written by `surrogate.export_model` and run by fmpy. Prints how far the run is from one without the detour.
"""

import multiprocessing
import tempfile
from itertools import pairwise
from pathlib import Path

import numpy as np

import coupled
import surrogate
import thermofem as th

STEP = 0.1e-9  # s, longest communication step


class Unit:
    """Keeps the contract of `coupled.loop.corrector.Corrector`. Few units can go back: the past is replayed."""

    def __init__(self, path, *, power="power_core", rise="delta_T_core"):
        from fmpy import extract, read_model_description
        from fmpy.fmi2 import FMU2Slave

        about = read_model_description(path)
        number = {variable.name: variable.valueReference for variable in about.modelVariables}
        self.power, self.rise = number[power], number[rise]
        name = about.coSimulation.modelIdentifier
        self.new = lambda: FMU2Slave(
            guid=about.guid, unzipDirectory=self.folder, modelIdentifier=name, instanceName="ring"
        )
        self.folder, self.past, self.unit, self.fresh = extract(path), [], None, False
        self._back()

    def _back(self):
        """A unit in the accepted state."""
        if self.unit is not None:
            self.unit.terminate()
            self.unit.freeInstance()
        self.unit = self.new()
        self.unit.instantiate()
        self.unit.setupExperiment(startTime=0.0)
        self.unit.enterInitializationMode()
        self.unit.exitInitializationMode()
        self.time, self.fresh = 0.0, True
        for h, watt in self.past:
            self._step(h, watt)

    def _step(self, h, watt):
        self.unit.setReal([self.power], [watt])
        self.unit.doStep(currentCommunicationPoint=self.time, communicationStepSize=h)
        self.time += h

    def advance(self, times, power):
        """Rise in K at ``times``; a step takes the power at its middle."""
        if not self.fresh:
            self._back()
        self.fresh, self.tried, rises = False, [], self.unit.getReal([self.rise])
        for start, stop in pairwise(times):
            h = (stop - start) / np.ceil((stop - start) / STEP)
            for watt in power(np.arange(start + h / 2, stop, h)):
                self.tried.append((h, float(watt)))
                self._step(*self.tried[-1])
            rises += self.unit.getReal([self.rise])
        return np.array(rises)

    def accept(self):
        """The end of the last call is kept."""
        self.past += self.tried
        self.fresh = True


def serve(pipe, path):
    """The other process: answers until it is told None."""
    unit = Unit(path)
    while (asked := pipe.recv()) is not None:
        pipe.send(unit.advance(*asked) if asked else unit.accept())


class Remote:
    """The corrector at this end of a connection."""

    def __init__(self, pipe):
        self.pipe = pipe

    def advance(self, times, power):
        """Rise in K at ``times``."""
        self.pipe.send((times, power))
        return self.pipe.recv()

    def accept(self):
        """The end of the last call is kept."""
        self.pipe.send(())
        self.pipe.recv()


def main():
    """Couple light and carriers here to the unit there."""
    heat = th.assemble(th.strip_ring())
    model = surrogate.reduce(heat.system, tolerance=1e-4).model
    drive = {"power": 6.31e-3, "duration": 1e-6}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "ring.fmu"
        surrogate.export_model(model, path, to="fmu")
        context = multiprocessing.get_context("spawn")
        here, there = context.Pipe()
        process = context.Process(target=serve, args=(there, str(path)))
        process.start()
        newton = th.Foster(R=[7900.0], tau=[417e-9])
        run = coupled.cosimulate(coupled.borghi2021(), Remote(here), predictor=newton, **drive)
        here.send(None)
        process.join(20)
    alone = coupled.simulate(coupled.borghi2021(), model, **drive)
    rise = np.interp(run["time"], alone["time"], alone["delta_T"])
    print(f"{run.attrs['passes']} passes of {run.attrs['windows']} windows through {path.name} in another process")
    print(f"largest rise {float(run.delta_T.max()):.2f} K, apart {1e3 * float(abs(run.delta_T - rise).max()):.1f} mK")


if __name__ == "__main__":
    main()
