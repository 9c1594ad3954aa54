"""Members of a family: small matrices by projection, their modes, and members that are solved on a mesh.

A reduced member is K(p) = V^T K_mesh(p) V. A member that is solved, on its own mesh or as a snapshot of the basis, is
reduced first (`surrogate.reduce`). Its fields x(s) = (K + s M)^-1 c at many shifts, on the real and on the imaginary
axis, are then combinations of a few modes. Each is divided by the square root of |Z(s)|: a projection that leaves the
share e of its energy errs by about e in Z(s). Members are solved on any Executor and kept in a folder.
"""

from __future__ import annotations

import contextlib
import io
import logging
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
from scipy.linalg import eigh

from thermofem import CrossSection, StateSpace, checks
from thermofem.algebra.krylov import symmetric_part
from thermofem.arrays import Array, NDArray
from thermofem.campaign.stored_tasks import Store, completed
from thermofem.data.files import LARGEST_FILE, digest, digest_tree
from thermofem.fem import HeatProblem
from thermofem.fem.assembly import meshed
from thermofem.geometry.section_parts import LIGHT

from ..reduction.reduce import Projected, project

log = logging.getLogger("thermofem")


@dataclass(frozen=True, eq=False)
class MemberModes:
    """A member in modal form; impedance between ports Z_ab(s) = sum_i port_ai port_bi / (1 + s tau_i).

    tau [shape (k,), s]
    ports [shape (ports, k)]: square root of K/W.
    """

    tau: Array
    ports: Array

    def R(self, heated: int = 0, read: int = 0) -> Array:
        """Resistances R_i of the poles in K/W between two ports, shape (k,)."""
        return self.ports[heated] * self.ports[read]

    def step_response(self, times: Array, heated: int = 0, read: int = 0) -> Array:
        """Rise of port ``read`` in K/W after a unit step of power in port ``heated``."""
        rises = -np.expm1(-times[:, None] / self.tau)
        return rises @ self.R(heated, read)


@dataclass(frozen=True, eq=False)
class MemberMatrices:
    """K (N, N) in W/K, M (N, N) in J/K and port functionals (ports, N) of one member, or of several stacked."""

    K: Array
    M: Array
    ports: Array

    def modes(self) -> MemberModes:
        """Modal form, from M v = tau K v with v^T K v = 1: round-off is relative to the largest tau and to R_th."""
        tau, v = eigh(self.M, self.K, check_finite=False)
        return MemberModes(np.maximum(tau, 0.0), self.ports @ v)

    def first(self, count: int) -> MemberMatrices:
        """The same member projected on the first ``count`` basis functions alone."""
        return MemberMatrices(self.K[:count, :count], self.M[:count, :count], self.ports[:, :count])


class HeldOut(float):
    """Error of a family at members that it was not trained on; as a float the worst one.

    worst, median: relative, of R_th and of the step response from 1 ns on, against the members' own finer meshes.
    count: of those members.
    """

    worst: float
    median: float
    count: int

    def __new__(cls, worst: float, median: float, count: int) -> HeldOut:
        """Make the number ``worst`` with the three attributes."""
        self = super().__new__(cls, worst)
        self.worst = worst
        self.median = median
        self.count = count
        return self

    def __reduce__(self) -> tuple[type[HeldOut], tuple[float, float, int]]:
        """How it is made again in a worker process."""
        return HeldOut, (self.worst, self.median, self.count)

    def __repr__(self) -> str:
        numbers = f"worst={self.worst:.2g}, median={self.median:.2g}, count={self.count}"
        return f"HeldOut({numbers})"


TIMES = np.geomspace(1e-9, 1e-3, 61)  # s; at which errors of step responses are looked at


def difference(modes: MemberModes, truth: MemberModes, heated: int = 1) -> float:
    """Largest relative difference of R_th and of the step response from 1 ns on, over all channels that both have.

    The first ``heated`` ports carry heat, all are read. A difference is relative to the value itself where a part reads
    its own heat, and to the static value of the channel elsewhere.
    """
    worst = 0.0
    for a in range(heated):
        for b in range(min(len(modes.ports), len(truth.ports))):
            static = truth.R(a, b).sum()
            rise = truth.step_response(TIMES, a, b)
            scale = rise if a == b else abs(static)
            off = np.abs(modes.step_response(TIMES, a, b) - rise) / scale
            static_off = abs(modes.R(a, b).sum() / static - 1)
            worst = max(worst, float(static_off), float(off.max()))
    return worst


def coarse_difference(small: MemberMatrices, heated: int) -> float:
    """`difference` between a member on the first 70 % of the basis functions and on all of them."""
    # with 0.7 of the functions, in the comparison behind `Family.predicted_error`
    count = max(1, int(0.7 * small.K.shape[0]))
    return difference(small.first(count).modes(), small.modes(), heated)


def pack(arrays: Mapping[str, Any], *, deflated: bool = True) -> bytes:
    """Archive of named arrays as bytes, with a hash of them."""
    memory = io.BytesIO()
    save: Any = np.savez_compressed if deflated else np.savez
    save(memory, **arrays, hash=np.array(_hash(arrays)))
    return memory.getvalue()


def unpack(raw: bytes) -> dict[str, NDArray[Any]]:
    """Named arrays of an archive that `pack` made.

    Raises
    ------
    ValueError
        no archive, a damaged one, one that unpacks to more than `LARGEST_FILE` bytes, or arrays that are not those
        of the hash.
    """
    if raw[:4] != b"PK\x03\x04":  # NumPy would say how to run what is in it
        raise ValueError("no archive")
    try:
        with np.load(io.BytesIO(raw), allow_pickle=False) as archive:
            if sum(member.file_size for member in archive.zip.infolist()) > LARGEST_FILE:
                raise ValueError(f"more than {LARGEST_FILE} bytes unpacked")
            arrays = {name: archive[name] for name in archive.files}
    except Exception as error:  # of NumPy, zipfile, zlib or the reader of headers, whatever is damaged
        raise ValueError(str(error) or type(error).__name__) from None
    if str(arrays.pop("hash", None)) != _hash(arrays):
        raise ValueError("it was changed after it was written")
    return arrays


def _hash(arrays: Mapping[str, Any]) -> str:
    content = {}
    for name, values in arrays.items():
        array = np.asarray(values)
        content[name] = [str(array.dtype), array.shape, digest(array.tobytes())]
    return digest_tree(content)


FINEST_MESH = 2e-5  # accuracy of the finest mesh made


@dataclass(frozen=True, eq=False)
class Certified:
    """A member checked on its own mesh.

    Attributes
    ----------
    heat : HeatProblem
    model : StateSpace
        certified reduction in modal form, with every part and read region of the family.
    thermal_resistance : float, K/W
        of the first heated part.
    error : float
        of the family: relative, of R_th and of the step response from 1 ns on.
    error_bound : float
        of ``model`` against its mesh, relative to R_th at every frequency.
    mesh_error : float
        estimated, of the mesh.
    """

    heat: HeatProblem = field(repr=False)
    model: StateSpace = field(repr=False)
    thermal_resistance: float
    error: float
    error_bound: float
    mesh_error: float


def fine_heat(geometry: CrossSection, tolerance: float) -> HeatProblem:
    """The heat problem of a member on its own mesh, finer than ``tolerance``; without "light" where it guides none."""
    # 0.2: accuracy of the member's own mesh over the tolerance of the family
    heat, _ = meshed(geometry, max(0.2 * tolerance, FINEST_MESH))
    try:
        return heat.lit
    except checks.InputError as error:
        log.warning("%s: its light is left out: %s", geometry.name, error)
        return heat


def certified_modes(heat: HeatProblem, ports: tuple[str, ...], tolerance: float) -> tuple[MemberModes, Projected]:
    """Certified reduction of a heat problem between its ports: modes, and the projection they come from.

    "light", the last of the ports, is left out where the problem has none.
    """
    d = heat.discretization
    names = tuple(name for name in ports if name in d.means or name != LIGHT)
    means = np.array([d.means[name][d.free] for name in names])
    system = StateSpace(E=d.E, A=-d.K, B=means.T, C=means, inputs=names, outputs=names)
    # 1e-2: tolerance of the reduction over that of the family
    projected = project(system, max(1e-2 * tolerance, 1e-7))
    rate = projected.projection.rate
    drives = projected.projection.ports.T
    return MemberModes(1 / rate, drives / np.sqrt(rate)), projected


def certified(
    geometry: CrossSection, modes: MemberModes, ports: tuple[str, ...], tolerance: float, heated: int
) -> Certified:
    """Compare a member with the certified reduction on its own mesh, which is finer than the family's tolerance.

    The first ``heated`` of the ports carry heat.
    """
    heat = fine_heat(geometry, tolerance)
    truth, projected = certified_modes(heat, ports, tolerance)
    rate = projected.projection.rate
    drives = projected.projection.ports
    gain = projected.projection.gain.diagonal()
    names = ports[: gain.size]  # without "light" where the mesh has none
    a, b = projected.pairs
    bounds = projected.certificate.top / np.sqrt(gain[a] * gain[b])
    return Certified(
        heat=heat,
        model=StateSpace(np.eye(rate.size), -np.diag(rate), drives, drives.T, inputs=names, outputs=names),
        thermal_resistance=float(truth.R().sum()),
        error=difference(modes, truth, heated),
        error_bound=float(bounds.max()),
        mesh_error=heat.mesh_error(ports[0]),
    )


FASTEST = 1e10  # 1/s; faster poles do not change the step response after 1 ns


@dataclass(frozen=True, eq=False)
class Member(MemberModes):
    """A member solved on the reference mesh, by the modes of its certified reduction.

    row [shape (p,)]
    fields [shape (unknowns, m)]: orthogonal combinations of the fields at all shifts, their energies decreasing.
    """

    row: Array
    fields: Array


def snapshot_of(engine: Any, row: Array, ports: tuple[str, ...], tolerance: float) -> Member:
    """Reduce a member on the reference mesh and compute its temperature fields at many shifts."""
    modes, projected = certified_modes(engine.heat(row), ports, tolerance)
    rate = projected.projection.rate  # (k,)
    slow = min(rate[0], FASTEST / 10)
    decades = np.log10(FASTEST / slow)
    shifts = np.geomspace(slow, FASTEST, int(4 * decades))  # four a decade
    weights = []
    for port in projected.projection.ports.T:
        for shift in (0.0, *shifts, *(1j * shifts)):
            y = port / (rate + shift)
            y = y / np.sqrt(abs(port @ y))
            weights.append(y.real)
            if np.iscomplexobj(y):
                weights.append(y.imag)
    W = np.array(weights).T  # modes by snapshots; energy of a mode is its rate
    root = np.sqrt(rate)[:, None]
    u, s, _ = np.linalg.svd(root * W, full_matrices=False)
    strong = s**2 > 1e-5 * tolerance  # 1e-5 of the tolerance: energy of a mode of the snapshots that is left out
    combinations = u[:, strong] * s[strong] / root
    return Member(modes.tau, modes.ports, row, projected.basis @ combinations)


def extend_basis(V: Array, X: Any, fields: Array, least: float) -> Array:
    """Extend X-orthonormal functions V by the principal directions of the fields outside their span, down to an energy.

    V [shape (n, k)]
    X [sparse, shape (n, n)]: inner product.
    fields [shape (n, m)]
    least: energy of the weakest direction that is added.
    """
    for _ in range(2):
        fields = fields - V @ (V.T @ (X @ fields))
    energies, directions = np.linalg.eigh(symmetric_part(fields.T @ (X @ fields)))
    round_off = 1e-13 * max(energies[-1], 1.0)
    strong = energies > max(least, round_off)
    if not strong.any():
        return V
    scaled = directions[:, strong] / np.sqrt(energies[strong])
    new = fields @ scaled[:, ::-1]  # the strongest first
    new = new - V @ (V.T @ (X @ new))
    lower = np.linalg.cholesky(new.T @ (X @ new))
    return np.hstack([V, np.linalg.solve(lower, new.T).T])


Task = tuple[Any, ...]
Job = tuple[int, Task]  # number of a task, and the task


def fine_member(geometry: str, ports: tuple[str, ...], tolerance: float) -> MemberModes:
    """Modes of a member on its own mesh, finer than ``tolerance``; geometry: text of its geometry file."""
    heat = fine_heat(CrossSection.from_toml_text(geometry), tolerance)
    return certified_modes(heat, ports, tolerance)[0]


@dataclass(frozen=True, eq=False)
class Solver:
    """Runs tasks on members, in an executor or in this process, and keeps their results.

    key: text that stands for all that the members share; results in the store under another key are left alone.
    executor: None solves in this process.
    store: keeps what is solved, open while the solver is called; None keeps nothing.
    progress: called as progress(done, total, words) after each task.
    """

    key: str
    executor: Executor | None = None
    store: Store | None = None
    progress: Callable[[float, float, str], None] | None = None

    def __call__(
        self,
        function: Callable[..., Any],
        tasks: Sequence[Task],
        marks: Iterable[Array],
        shared: str = "",
        *,
        words: str = "members",
    ) -> list[Any]:
        """Run ``function`` on the arguments of every task but those whose result the store has.

        marks: an array for each task, such as the parameters of its member, that tells it from the others.
        shared: what the tasks have in common beside `key`.
        words: what is solved, for the progress.
        Returns: results in the order of the tasks, None for a task that failed, which a line in the log names.
        Raises InputError: one that a task raised, or all tasks failed.
        """
        common = f"{self.key} {function.__name__} {shared}".encode()
        keys = [digest(common + np.ascontiguousarray(mark).tobytes())[:24] for mark in marks]
        archives = [self.store.read(key) if self.store else None for key in keys]
        solved = [None if archive is None else _member(archive) for archive in archives]
        jobs = [(k, tasks[k]) for k, member in enumerate(solved) if member is None]
        reason = ""
        work = partial(_of_job, function)
        with contextlib.closing(self._results(work, jobs)) as results:
            for done, (k, result) in enumerate(results):
                if self.progress is not None:
                    self.progress(done, len(jobs), words)
                try:
                    solved[k] = result()
                except checks.InputError:
                    raise
                except Exception as error:
                    reason = f"{type(error).__name__}: {error}"
                    log.warning("a member failed and is left out: %s", reason)
                    continue
                if self.store:
                    self.store.write(keys[k], pack(vars(solved[k]), deflated=False))
        if tasks and all(member is None for member in solved):
            raise checks.InputError(f"every member of a batch failed, the last one with {reason}")
        return solved

    def _results(self, work: Callable[[Job], Any], jobs: list[Job]) -> Generator[tuple[int, Callable[[], Any]]]:
        """Index of each task, and a function that returns its result."""
        if self.executor is None:
            yield from ((job[0], partial(work, job)) for job in jobs)
        else:
            yield from ((job[0], done.result) for job, done in completed(work, jobs, executor=self.executor))


def _of_job(function: Callable[..., Any], job: Job) -> Any:
    return function(*job[1])


def _member(raw: bytes) -> Member | MemberModes:
    """The member, or the modes alone, whose arrays an archive holds."""
    arrays = unpack(raw)
    return Member(**arrays) if "row" in arrays else MemberModes(**arrays)
