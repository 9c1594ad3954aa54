"""Train all compact models of one geometry, from one pole to the certified reduction, and compare them."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import xarray as xr

from thermofem import Constant, Foster, Probe, SquareWave, Telegraph, assemble, checks, dataset, waveforms
from thermofem.arrays import ArrayLike
from thermofem.data.dataset import describe
from thermofem.data.variables import contents
from thermofem.fem import HeatProblem
from thermofem.models import NonlinearSystem, ThermalModel, foster

from ..fitting.fit import fit_foster, fit_newton, fit_second_order
from ..fitting.sindy import fit_sindy
from ..reduction.balanced import balanced_truncation
from ..reduction.nonlinear_reduction import output_map, reduce_quadratic
from ..reduction.reduce import reduce
from .validate import PERIODS, error_curve, labelled, states_of, swings, widest_range

SHELLS = (0.1e-6, 0.3e-6, 0.8e-6, 1.8e-6)  # m around the heated part, states of SINDy
TOLERANCES = (0.1, 0.03, 0.01, 0.001, 1e-4)
TRAINING_SAMPLES = 301  # of the periodic state that Newton and the second order are trained on


@dataclass(frozen=True, eq=False)
class Ladder:
    """Compact models of one geometry, by name, and the reference model.

    Attributes
    ----------
    models : mapping from a name to a ThermalModel
    reference : ThermalModel
        the certified reduction to 1e-6; with k(T) the quadratic reduction.
    reference_error : float
        certificate of it; with k(T) the error of its steady rise at three quarters of the power.
    refused : mapping from a name to the reason
        models that could not be trained on this geometry.
    """

    models: Mapping[str, ThermalModel]
    reference: ThermalModel
    reference_error: float
    refused: Mapping[str, str]


def train_all(
    heat: HeatProblem,
    *,
    power: float = 2e-3,
    duty: float = 1 / 3,
    hot: float | None = None,
    names: Sequence[str] | None = None,
    heated: str | None = None,
    read: str | None = None,
) -> Ladder:
    """Train Newton, second order, SINDy and Foster networks and reduce the FEM to several orders.

    All are trained at small power on one channel, from a heated part to what is read: Newton and second order on the
    paper's square wave (1 us), Foster networks on a step, SINDy on a telegraph. The drives come from the certified
    reduction to 1e-6. With k(T) an output map is made for a larger power.

    Parameters
    ----------
    heat : HeatProblem
    power : float, W
        of the training drives.
    duty : float
        of the square wave.
    hot : float, W
        with k(T): the largest power of interest, which the reference and the output map are made for; default ten times
        ``power``; 0 leaves k(T) out, of the reference too.
    names : sequence of str
        the models to train, such as "Newton" or "Foster, trained (5)"; default all of them.
    heated, read : str, optional
        part that is heated, default the first that can be; what is read, default the same. SINDy takes no other.

    Raises
    ------
    InputError
        a power or duty out of range, a name that is none of the models', of no heated part, of nothing that is read.
    """
    power = checks.power("power", power)
    part = checks.choice("heated", heated, heat.heated, default=heat.heated[0])
    read = part if read is None else checks.text("read", read)
    system = heat.channels(part, read)
    fine = reduce(system, 1e-6)  # 1e-6: certificate of what the others are judged by
    exact: Foster = fine.model  # type: ignore[assignment]  # one channel
    periodic, step = training_data(exact, power, duty, {"heated": part, "read": read})
    makers: dict[str, Callable[[], ThermalModel]] = {
        "Newton": lambda: fit_newton(periodic).model,
        "second order": lambda: fit_second_order(periodic).model,
        "SINDy": lambda: fit_sindy(*shells(heat, part, read, power)).model,
    }
    orders = range(3, 9)
    makers |= {f"Foster, trained ({n})": lambda n=n: fit_foster(step, n).model for n in orders}  # type: ignore[misc]
    makers |= {f"balanced truncation ({n})": lambda n=n: balanced_truncation(system, n).model for n in orders}  # type: ignore[misc]
    makers |= {f"certified reduction ({t:g})": lambda t=t: reduce(system, t).model for t in TOLERANCES}  # type: ignore[misc]
    reference: ThermalModel = exact
    error = fine.error_bound
    hot = 10 * power if hot is None else checks.between("hot", hot, 0, 10, unit="W")
    if heat.nonlinear and hot:
        model: NonlinearSystem = heat.model(part, read)  # type: ignore[assignment]  # heat.nonlinear
        quadratic = reduce_quadratic(model, hot)
        reference = quadratic.model
        error = quadratic.static_error
        makers["output map"] = lambda: output_map(model, hot)
    models = {}
    refused = {}
    for name in makers if names is None else checks.instances("names", names, str):
        make = makers[checks.choice("names", name, makers)]
        try:
            models[name] = make()
        except (checks.InputError, checks.MissingLibraryError) as reason:
            refused[name] = str(reason)
    return Ladder(models, reference, error, refused)


def training_data(
    exact: Foster, power: float, duty: float, channel: Mapping[str, str] | None = None
) -> tuple[Any, Any]:
    """Training data of a precise model: one period of a 1 us square wave, and a step from 1 ns until it has settled."""
    square = SquareWave(power, 1e-6, duty)
    constant = Constant(power)
    times = waveforms.period_times(square, TRAINING_SAMPLES)
    rise = exact.periodic_response(square, TRAINING_SAMPLES)
    periodic = dataset.build(times, rise, square, periodic=True, attributes=channel)
    times = np.geomspace(1e-9, 50 * float(np.max(exact.tau)), 121)
    attributes = {"thermal_resistance": exact.thermal_resistance, **(channel or {})}
    step = dataset.build(times, exact.response(constant, times), constant, attributes=attributes)
    return periodic, step


def fit_usual(exact: Foster) -> dict[str, ThermalModel]:
    """A Foster network of five poles, the second-order equation and Newton's law, trained on a precise model."""
    ports = {"heated": exact.inputs[0], "read": exact.outputs[0]}
    periodic, step = training_data(exact, 2e-3, 1 / 3, ports)
    return {
        "Foster, 5 poles": fit_foster(step, 5).model,
        "second order": fit_second_order(periodic).model,
        "Newton's law": fit_newton(periodic).model,
    }


def shells(heat: HeatProblem, part: str, read: str, power: float) -> tuple[xr.Dataset, list[float]]:
    """Training data of `fit_sindy`: rises of a part and of shells around it, and their static gains in K/W.

    From a certified reduction with all of them as outputs, in closed form, sampled every 2 ns for 40 us.
    Raises InputError: another part is read.
    """
    if read != part:
        raise checks.InputError(f"SINDy reads the heated part {part!r} and shells around it; {read!r} is another")
    probes = tuple(Probe(name=f"shell {d * 1e6:g} um", part=part, shell=d) for d in SHELLS)
    probed = assemble(replace(heat.geometry, probes=probes), heat.accuracy)
    names = (part, *(probe.name for probe in probes))
    fine: Any = reduce(probed.channels(part, names), 1e-5).model  # several outputs
    models = [foster(fine.channel(part, name)) for name in names]
    times = np.arange(20_000) * 2e-9
    wave = Telegraph(power, dwell=5e-7, duration=4e-5, seed=1)
    rises = np.stack([model.response(wave, times) for model in models], axis=1)
    return dataset.build(times, rises, wave, read=names), [model.thermal_resistance for model in models]


def judge(
    models: Mapping[str, ThermalModel],
    reference: ThermalModel,
    *,
    powers: Sequence[float] = (2e-3,),
    periods: ArrayLike = PERIODS,
    duty: float = 1 / 3,
) -> xr.Dataset:
    """Period and swing errors of several models over periods and powers, and where each can be trusted.

    Parameters
    ----------
    models : mapping from a name to a ThermalModel
    reference : ThermalModel
        also the FEM with k(T), ``heat.model("core", "core")``.
    powers : sequence of float, W
        of the square wave; more than one tells something where k depends on temperature.
    periods : array, s
        default 13 from .1 to 10 us.
    duty : float

    Returns
    -------
    Dataset
        over ``model``, ``power`` (W) and ``period`` (s): ``period_error`` (relative, `period_error`) and
        ``swing_error`` (relative); over model and power: ``shortest`` and ``longest`` period (s) of the range within
        10 %, nan where there is none; over model: ``states``. ``attrs["verdict"]`` says it in words.
    """
    periods = checks.array("periods", periods, increasing=True)
    watts = checks.array("powers", powers, increasing=True)
    checks.unique("powers", watts.tolist())
    shape = (len(models), watts.size, periods.size)
    error = np.empty(shape)
    swing = np.empty(shape)
    ends = np.empty((*shape[:2], 2))
    for j, power in enumerate(watts):
        exact = swings(reference, periods, float(power), duty)
        for i, model in enumerate(models.values()):
            curve = error_curve(model, exact, periods, float(power), float(duty))
            error[i, j] = curve["relative_error"].values
            ends[i, j] = widest_range(curve)
            swing[i, j] = curve["swing_model"].values / exact - 1
    coords = {
        "model": list(models),
        "power": ("power", watts, describe("power")),
        "period": ("period", periods, describe("period")),
    }
    errors = (
        ("period_error", error, "1", "period error over period"),
        ("swing_error", swing, "1", "swing error over swing"),
    )
    shortest, longest = np.moveaxis(ends, -1, 0)
    ranges = (
        ("shortest", shortest, "s", "shortest period within 10 %"),
        ("longest", longest, "s", "longest period within 10 %"),
    )
    variables = labelled(errors, "model", "power", "period") | labelled(ranges, "model", "power") | states_of(models)
    judged = xr.Dataset(variables, coords)
    return judged.assign_attrs(verdict=verdict(judged), duty=float(duty))


USUAL = "Newton", "second order", "Foster, trained (3)", "Foster, trained (5)", "SINDy", "certified reduction (0.0001)"


def judge_geometry(
    heat: HeatProblem,
    *,
    power: float = 2e-3,
    periods: ArrayLike = PERIODS,
    duty: float = 1 / 3,
    heated: str | None = None,
    read: str | None = None,
) -> tuple[Ladder, xr.Dataset]:
    """Train the usual kinds of model on a geometry and judge them by its FEM, with k(T) at the power given.

    Without k(T) the FEM is replaced by its reduction to 1e-6; with it, in full order, and an output map and a quadratic
    reduction join the models. The other arguments are those of `train_all` and `judge`, whose results are returned.
    """
    heated = checks.choice("heated", heated, heat.heated, default=heat.heated[0])
    read = checks.choice("read", read, heat.readable, default=heated)
    ladder = train_all(heat, power=power, duty=duty, hot=0, names=USUAL, heated=heated, read=read)
    system = heat.model(heated, read)
    if isinstance(system, NonlinearSystem):
        models: dict[str, ThermalModel] = {**ladder.models, "output map": output_map(system, power)}
        models["quadratic reduction"] = reduce_quadratic(system, power).model
        ladder = replace(ladder, models=models, reference=system, reference_error=0.0)
    return ladder, judge(ladder.models, ladder.reference, powers=[power], periods=periods, duty=duty)


def linear_reach(system: NonlinearSystem) -> xr.Dataset:
    """Steady rise of a FEM with k(T) at 0.5 to 50 mW, and the errors of linear models and of an output map there.

        linear_error = R_th P/dT - 1,    map_error = dT_map/dT - 1,    R_th at small power

    The output map is made for the largest power. Powers (W) from the first without a steady state on are left out.
    """
    rises = []
    for power in np.geomspace(0.5e-3, 50e-3, 9).tolist():
        try:
            rise, *_ = system.steady_rise(power)
        except checks.InputError:  # the conductivity has gone
            break
        rises.append((power, float(rise)))
    watts, kelvin = np.array(rises).T
    of_map = output_map(system, float(watts[-1]))
    mapped = np.array([of_map.steady_rise(power) for power in watts.tolist()])
    linear = system.thermal_resistance * watts
    errors = {"rise": kelvin, "linear_error": linear / kelvin - 1, "map_error": mapped / kelvin - 1}
    return xr.Dataset({name: ("power", column) for name, column in errors.items()}, {"power": watts})


def verdict(judged: xr.Dataset, *, within: float = 0.1) -> str:
    """Which model suffices where: the smallest that suffices at all periods, and the ranges of those that do not.

    judged [Dataset of `judge`]: ``period_error`` over model, power (W) and period (s), and ``states`` of each model.
    within: relative error that is allowed.
    Returns: for each power one line, and one for each model that does not suffice at all periods.
    Raises InputError: no Dataset of `judge`, or a limit that is not positive.
    """
    within = checks.positive("within", within, hint="0.1 is ten percent")
    needed = ("model", "power", "period", "states", "period_error")
    judged = contents("judged", judged, needed, what="a Dataset of surrogate.judge")
    lines = []
    low, high = 1e6 * judged["period"].values[[0, -1]]
    for power in judged["power"].values:
        of_power = judged.sel(power=power)
        suffice = []
        ranges = []
        for model in of_power["model"].values:
            curve = of_power.sel(model=model).rename(period_error="relative_error")
            worst = float(abs(curve["relative_error"]).max())
            if worst <= within:
                suffice.append((float(curve["states"]), worst, model))
                continue
            shortest, longest = widest_range(curve, within=within)
            reach = f"{shortest * 1e6:.3g} to {longest * 1e6:.3g} us" if shortest <= longest else "nowhere"
            ranges.append(f"  {model}: {reach}")
        best = "no model suffices everywhere"
        if suffice:
            count, _, smallest = min(suffice)
            best = f"{smallest} suffices ({count:.0f} states)"
        lines.append(f"{power * 1e3:g} mW, {low:g} to {high:g} us, within {within:.0%}: {best}")
        lines += ranges
    return "\n".join(lines)
