"""PETSc's adaptive Rosenbrock-W on matrices from a file; run by a Python that has petsc4py, as `bench_peers` does.

    python3 peer_petsc.py matrices.npz rtol

ra34pw2 with PETSc's own step control and an LU factorization in every step; the pulse's two halves are solved one after
the other, each from the edge on. Prints JSON: CPU seconds, largest error at the given times, steps.
"""

import json
import sys
import time

import numpy as np
import petsc4py

petsc4py.init([])
from petsc4py import PETSc  # noqa: E402 - after init


def matrix(content, name):
    n = content["b"].size
    A = PETSc.Mat().createAIJ(
        size=(n, n), csr=(content[f"{name}_indptr"], content[f"{name}_indices"], content[f"{name}_data"])
    )
    A.assemble()
    return A


def main(path, rtol):
    content = dict(np.load(path))
    E, A = matrix(content, "E"), matrix(content, "A")
    b, c, times, reference = (content[name] for name in ("b", "c", "times", "reference"))
    x, load, found, steps = A.createVecLeft(), A.createVecLeft(), [], 0
    x.set(0.0)
    start = time.process_time()
    for half, power in enumerate((2e-3, 0.0)):
        wanted = times[:, half]
        load.setArray(b * power)
        rises, last, between = [], [0.0], A.createVecLeft()

        def residual(ts, t, u, udot, f, load=load):
            E.mult(udot, f)
            work = A.createVecLeft()
            A.mult(u, work)
            f.axpy(-1.0, work)
            f.axpy(-1.0, load)

        def jacobian(ts, t, u, udot, shift, J, P):
            P.zeroEntries()
            P.axpy(shift, E, PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)
            P.axpy(-1.0, A, PETSc.Mat.Structure.SAME_NONZERO_PATTERN)
            P.assemble()

        def watch(ts, k, t, u, rises=rises, last=last, wanted=wanted, between=between):
            for at in wanted[(wanted > last[0]) & (wanted <= t)] if k else ():
                ts.interpolate(at, between)
                rises.append(float(c @ between.getArray(readonly=True)))
            last[0] = t

        ts = PETSc.TS().create()
        ts.setType(PETSc.TS.Type.ROSW)
        ts.setIFunction(residual, A.createVecLeft())
        P = A.duplicate(copy=True)
        ts.setIJacobian(jacobian, P)
        ts.setMonitor(watch)
        ts.setTime(0.0)
        ts.setTimeStep(1e-11)
        ts.setMaxTime(20e-6)
        ts.setMaxSteps(100000)
        ts.setExactFinalTime(PETSc.TS.ExactFinalTime.MATCHSTEP)
        ts.setTolerances(rtol=rtol, atol=rtol * 20.0)
        ts.getSNES().setType("ksponly")
        ksp = ts.getSNES().getKSP()
        ksp.setType("preonly")
        ksp.getPC().setType("lu")
        ts.setFromOptions()
        ts.solve(x)
        steps += ts.getStepNumber()
        found.append(rises)
    seconds = time.process_time() - start
    error = float(np.abs(np.array(found).T - reference).max() / reference.max())
    print(json.dumps({"seconds": seconds, "error": error, "steps": steps}))


main(sys.argv[1], float(sys.argv[2]))
