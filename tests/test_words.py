"""One word has one meaning: names of classes, keywords of functions (docs/equations.md)."""

from __future__ import annotations

import ast
from collections import Counter
from collections.abc import Iterator

import numpy as np
from paths import ROOT

import coupled
import surrogate
import thermofem as th

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
