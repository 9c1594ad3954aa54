"""Another solver in the loop: NGSolve, on a mesh and elements of its own, in a process of its own.

    python examples/ngsolve_corrector.py serve      # where ngsolve is installed (pip install ngsolve); waits
    python examples/ngsolve_corrector.py            # where thermofem is installed; runs the ring, and the FEM beside it

The processes talk over multiprocessing.connection of the standard library; neither needs what the other imports.
Printed: how far the temperatures of the two solvers are apart, and what the coupling took.
"""

import sys
from multiprocessing.connection import Client, Listener

import numpy as np

ADDRESS, KEY = ("localhost", 6321), b"thermofem"
STEP = 0.5e-9  # s, of NGSolve's time integration


class NGSolveStrip:
    """The reference strip in NGSolve: cubic elements, the weight 2 pi r, and an L-stable SDIRK method of order 2."""

    def __init__(self):
        import ngsolve as ng
        from netgen.geom2d import CSG2d, Rectangle

        plane = CSG2d()
        core = Rectangle((7.73, 0), (8.18, 0.22), mat="core")
        oxide = Rectangle((0, -2), (60, 2.22), mat="oxide")
        plane.Add(core.Maxh(0.03))
        plane.Add((oxide - core).Maxh(3))
        plane.Add(Rectangle((0, -32), (60, -2), mat="substrate", bottom="held").Maxh(3))
        mesh = ng.Mesh(plane.GenerateMesh(maxh=3, grading=0.25))
        V = ng.H1(mesh, order=3, dirichlet="held")
        u, v = V.TnT()
        around = 2 * np.pi * ng.x  # lengths in um: 1e-6 on conduction, 1e-18 on capacity
        k = mesh.MaterialCF({"core": 130, "oxide": 1.38, "substrate": 130})
        c = mesh.MaterialCF({"core": 2330 * 700, "oxide": 2203 * 703, "substrate": 2330 * 700})
        self.K = ng.BilinearForm(1e-6 * k * ng.grad(u) * ng.grad(v) * around * ng.dx).Assemble().mat
        self.M = ng.BilinearForm(1e-18 * c * u * v * around * ng.dx).Assemble().mat
        volume = ng.Integrate(around * ng.dx("core"), mesh)
        self.mean = ng.LinearForm(around / volume * v * ng.dx("core")).Assemble().vec
        self.free, self.unknowns, self.inverses = V.FreeDofs(), V.ndof, {}
        self.accepted = self.mean.CreateVector()
        self.accepted[:] = 0

    def inverse(self, shift):
        """(M + shift K)^-1, kept."""
        if shift not in self.inverses:
            matrix = self.M.CreateMatrix()
            matrix.AsVector().data = self.M.AsVector() + shift * self.K.AsVector()
            self.inverses[shift] = matrix.Inverse(self.free, inverse="sparsecholesky")
        return self.inverses[shift]

    def advance(self, times, power):
        """Rise of the core in K at ``times``."""
        import ngsolve as ng

        steps = int(np.ceil((times[-1] - times[0]) / STEP))
        grid = np.linspace(times[0], times[-1], steps + 1)
        h, gamma = (grid[-1] - grid[0]) / steps, 1 - np.sqrt(0.5)
        inverse = self.inverse(float(f"{gamma * h:.6e}"))
        x, rises = self.accepted.CreateVector(copy=True), [ng.InnerProduct(self.mean, self.accepted)]
        rest, first, second = (x.CreateVector() for _ in range(3))
        heats = power(np.add.outer(grid[:-1], [gamma * h, h]))
        for early, late in heats:
            rest.data = float(early) * self.mean - self.K * x
            first.data = inverse * rest
            x.data += (1 - gamma) * h * first
            rest.data = float(late) * self.mean - self.K * x
            second.data = inverse * rest
            x.data += gamma * h * second
            rises.append(ng.InnerProduct(self.mean, x))
        self.tried = x
        return np.interp(times, grid, rises)

    def accept(self):
        """Keep the end of the last call."""
        self.accepted.data = self.tried


class Remote:
    """The corrector as thermofem sees it: two messages."""

    def __init__(self):
        self.connection = Client(ADDRESS, authkey=KEY)

    def advance(self, times, power):
        """Rise of the core in K at ``times``, from the other process."""
        self.connection.send((times, power.times, power.power, power.slope))
        return self.connection.recv()

    def accept(self):
        """Have it keep the end of the last call."""
        self.connection.send("accept")


def serve():
    """Answer one client until it leaves."""
    solver = NGSolveStrip()
    print(f"NGSolve with {solver.unknowns} unknowns waits at {ADDRESS}", flush=True)
    with Listener(ADDRESS, authkey=KEY) as listener, listener.accept() as connection:
        while True:
            try:
                message = connection.recv()
            except EOFError:
                return
            if message == "accept":
                solver.accept()
            else:
                times, *spline = message
                connection.send(solver.advance(times, hermite(*spline)))


def hermite(times, values, slopes):
    """The power as the client's spline, a function of time."""

    def power(t):
        k = np.clip(np.searchsorted(times, t, side="right") - 1, 0, times.size - 2)
        h = times[k + 1] - times[k]
        u, rise, d0, d1 = (t - times[k]) / h, values[k + 1] - values[k], h * slopes[k], h * slopes[k + 1]
        return values[k] + u * (d0 + u * (3 * rise - 2 * d0 - d1 + u * (d0 + d1 - 2 * rise)))

    return power


def main():
    """Run the ring with our FEM and with theirs."""
    import coupled
    import thermofem as th

    ring, drive = coupled.borghi2021(), {"power": 6.31e-3, "duration": 1e-6}
    heat = th.assemble(th.strip_ring())
    ours = coupled.cosimulate(ring, heat, **drive)
    predictor = coupled.FEM(heat).predictor
    theirs = coupled.cosimulate(ring, Remote(), predictor=predictor, max_discrepancy=5e-3, **drive)
    apart = np.abs(np.interp(ours.time, theirs.time, theirs.delta_T) - ours.delta_T).max()
    print(f"largest rise {float(ours.delta_T.max()):.3f} K, the two solvers are {float(apart) * 1e3:.1f} mK apart")
    print(f"{theirs.attrs['windows']} windows, {theirs.attrs['passes']} passes")


if __name__ == "__main__":
    serve() if sys.argv[1:] == ["serve"] else main()
