"""One word has one meaning: names of classes, keywords of functions, and old names, which warn (docs/equations.md)."""

from __future__ import annotations

import ast
from collections import Counter
from collections.abc import Iterator
from importlib import import_module

import numpy as np
import pytest
from paths import ROOT

import coupled
import surrogate
import thermofem as th
from thermofem.campaign import Drive, Variation
from thermofem.plot import animate_field

TREES = {
    path.relative_to(ROOT): ast.parse(path.read_text())
    for package in ("thermofem", "surrogate", "coupled")
    for path in sorted((ROOT / package).rglob("*.py"))
}
STEP, TIMES = th.Constant(1e-3), np.linspace(0, 1e-6, 41)
HEAT = th.StateSpace(E=np.eye(1) * 1e-12, A=-np.eye(1) * 2e-4, B=np.eye(1), C=np.eye(1))


def functions() -> Iterator[tuple[str, ast.FunctionDef]]:
    """Every function and method, with the file that it is in."""
    for path, tree in TREES.items():
        yield from ((f"{path}: {node.name}", node) for node in ast.walk(tree) if isinstance(node, ast.FunctionDef))


def test_no_two_classes_share_a_name():
    names = Counter(n.name for tree in TREES.values() for n in tree.body if isinstance(n, ast.ClassDef))
    assert not [name for name, count in names.items() if count > 1 and not name.startswith("_")]


def test_progress_is_called_with_a_time():
    """What is called with anything else, or is no function, has another name."""
    wrong = [
        where
        for where, node in functions()
        for argument in (*node.args.args, *node.args.kwonlyargs)
        if argument.arg == "progress" and argument.annotation is not None
        if not ast.unparse(argument.annotation).startswith("Callable[[float], None]")
    ]
    assert wrong == []


def test_a_drive_is_a_power_over_time():
    """No amplitude and no array of a right-hand side: these are a pump and a forcing."""
    wrong = [
        where
        for where, node in functions()
        for argument in (*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs)
        if argument.arg == "drive" and argument.annotation is not None
        if ast.unparse(argument.annotation).split("[")[0] in ("float", "int", "str", "Array", "NDArray", "ArrayLike")
    ]
    assert wrong == []


def test_only_reductions_lift():
    homes = {where.split(":")[0] for where, node in functions() if node.name == "lift"}
    assert homes == {"surrogate/reduction/reduce.py", "surrogate/reduction/truncate.py"}


@pytest.mark.parametrize(
    ("call", "new"),
    [
        (lambda: coupled.cosimulate(coupled.borghi2021(), HEAT, power=1e-3, tolerance=0), "max_discrepancy"),
        (lambda: coupled.FEM(HEAT, tolerance=0), "max_discrepancy"),
        (lambda: coupled.pulsing_map(None, None, [1e-3], [0.0], progress=True), "show_bar"),
        (lambda: coupled.identify(None, [], free=[], progress=True), "show_bar"),
        (lambda: coupled.fit_newton_per_trace(None, [], progress=True), "show_bar"),
        (lambda: surrogate.train_family("nowhere.toml", progress=print), "report"),
        (lambda: surrogate.uncertainty(None, {}, layer=40), "interpolate"),
        (lambda: animate_field(None, "heat.gif", progress=print), "on_frame"),
    ],
    ids=[
        "cosimulate",
        "FEM",
        "pulsing_map",
        "identify",
        "fit_newton_per_trace",
        "train_family",
        "uncertainty",
        "animate_field",
    ],
)
def test_an_old_keyword_warns_and_works(call, new):
    """It reaches the checks of the function, which refuse what else was given."""
    with (
        pytest.warns(DeprecationWarning, match=f"is now {new}; the old name goes with 0.3"),
        pytest.raises(th.InputError),
    ):
        call()


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("thermofem.model", "thermofem.models"),
        ("surrogate.lumped", "thermofem.models.lumped"),
        ("surrogate.plot_array", "surrogate.plot"),
        ("coupled.plot_circuit", "coupled.plot.circuit"),
        ("coupled.plot_cycles", "coupled.plot.cycles"),
    ],
)
def test_an_old_module_gives_the_objects_of_the_new_one(old, new):
    before, now = import_module(old), import_module(new)
    shared = set(before.__all__) & set(dir(now))
    assert shared
    assert all(getattr(before, name) is getattr(now, name) for name in shared)


def test_a_schedule_of_a_campaign_is_a_drive_now():
    geometry, wide = th.strip_ring().to_toml(), Variation("width", ("part.core.width",), "m", (450e-9, 500e-9))
    with pytest.warns(
        DeprecationWarning, match=r"thermofem\.campaign\.Schedule is now thermofem\.campaign\.Drive"
    ) as seen:
        from thermofem.campaign import Schedule
    assert seen[0].filename == __file__
    step = Schedule("step", th.Constant(1e-3), (0.0, 1e-6))
    with pytest.warns(DeprecationWarning, match="Campaign: schedules is now drives"):
        old = th.Campaign(geometry, (wide,), schedules=(step,))
    new = th.Campaign(geometry, (wide,), drives=(Drive("step", th.Constant(1e-3), (0.0, 1e-6)),))
    assert [case.key for case in old.cases()] == [case.key for case in new.cases()]
    with pytest.warns(DeprecationWarning, match=r"Campaign\.schedules is now Campaign\.drives"):
        assert old.schedules == new.drives


def test_the_old_name_of_variable_projection_warns_and_works():
    data = th.dataset.build(TIMES, surrogate.newton(tau_th=60e-9, heat_capacity=7e-12).response(STEP, TIMES), STEP)
    with pytest.warns(DeprecationWarning, match="is now method='variable projection'") as caught:
        old = surrogate.fit_newton(data, method="projection")
    assert caught[0].filename == __file__  # the line that a user has to change
    assert old.parameters == surrogate.fit_newton(data).parameters


def test_power_says_which_power_it_is():
    """Absorbed in thermal data; in the bus waveguide in results of `coupled`; there the absorbed one is `absorbed`."""
    model, ring = surrogate.newton(tau_th=60e-9, heat_capacity=7e-12), coupled.borghi2021()
    absorbed = [
        th.dataset.build(TIMES, model.response(STEP, TIMES), STEP),
        surrogate.judge({"Newton": model}, model, periods=[1e-6], powers=[1e-3]),
    ]
    assert {data["power"].long_name for data in absorbed} == {"absorbed power"}
    plane = [3e-3, 6e-3], [-10e9, 0.0]
    in_bus = [
        coupled.stability_map(ring, model, *plane),
        coupled.transmission(ring, model, power=6e-3, detuning=(-10e9, 10e9)),
        *coupled.fold_curves(ring, model, [1e-3, 20e-3], [-80e9, 0.0]),
    ]
    assert len(in_bus) > 2
    assert {data["power"].long_name for data in in_bus} == {"power in the bus waveguide"}
