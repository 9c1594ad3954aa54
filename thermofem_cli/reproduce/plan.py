"""The stages of a reproduction, in order."""

from __future__ import annotations

from . import (
    carrier_stages,
    fit_stages,
    heat_stages,
    loop_stages,
    map_stages,
    paper_stages,
    pulsing_stages,
    stack_stages,
    training_stages,
)
from .settings import Settings
from .stages import Stage

FEM = ("accuracy",)
MODELS = ("elements", "training", "second_order_fit")
LOOP = ("accuracy", "run")
MAPS = ("grid", "duration")
STAGES = (
    Stage("elements", "finite elements and their reduction", heat_stages.elements, (), FEM, 0.3, quick=True),
    Stage("stacks", "the ring in other stacks", heat_stages.stacks, (), FEM, 1.5),
    Stage("hot", "k(T) and c_p(T)", heat_stages.hot, (), FEM, 1),
    Stage("pulse", "Fig. 5(a): 20 µs pulse", heat_stages.pulse, (), FEM, 0.3, quick=True),
    Stage("squares", "square waves of 1 and 0.8 µs", heat_stages.squares, (), FEM, 0.2, quick=True),
    Stage("training", "training on the FEM", training_stages.training, ("elements", "squares"), FEM, 2, quick=True),
    Stage("drives", "training on other drives", training_stages.drives, ("elements",), FEM, 0.5),
    Stage("ring", "the ring's own numbers", paper_stages.ring, ("elements",), (), 0.2, quick=True),
    Stage("carriers", "Fig. 3(b): carrier lifetime", carrier_stages.carriers, (), (), 0.1, quick=True),
    Stage("periods", "Fig. 7: period error", training_stages.periods, ("elements", "training"), FEM, 0.1, quick=True),
    Stage("traces", "self-pulsing at (8 dBm, 0 GHz)", pulsing_stages.traces, MODELS[:2], (), 0.1, quick=True),
    Stage("runs", "the paper's own models", paper_stages.runs, (), (), 4),
    Stage("readings", "the print at its word", paper_stages.readings, (), ("grid",), 0.5),
    Stage("heating", "Fig. 5(b): the heat of self-pulsing", pulsing_stages.heating, (), (*FEM, "cycle"), 0.2),
    Stage("stacks_explained", "stacks that explain the experiment", stack_stages.explained, (), ("cycle",), 6),
    Stage("loop", "FEM in the loop", loop_stages.loop, ("elements",), (*LOOP, "fitted"), 7),
    Stage("loop_map", "FEM in the loop: a map", loop_stages.loop_map, ("elements",), (*LOOP, "grid", "loop_every"), 14),
    Stage("newton_fits", "Fig. 4(d): Newton's law fitted to traces", fit_stages.newton_fits, ("loop",), (), 7),
    Stage("second_order_fit", "second order fitted to traces", fit_stages.second_order_fit, ("loop",), ("runs",), 18),
    Stage("marked", "Figs. 4(c) and 6(c): traces", pulsing_stages.marked, (*MODELS, "newton_fits"), ("run",), 0.2),
    Stage("reference", "maps: the FEM", map_stages.reference, ("elements", "periods"), MAPS, 4),
    Stage("maps", "Figs. 4 and 6: maps", map_stages.maps, (*MODELS, "reference"), MAPS, 20),
    Stage("scan", "Fig. 4: would any Newton's law do?", map_stages.scan, ("reference",), ("scan",), 9),
    Stage("rings", "Fig. 7: two rings", map_stages.rings, ("elements", "second_order_fit"), MAPS, 3),
    Stage("cost", "what each model costs", pulsing_stages.cost, (*MODELS, "loop"), ("repeats", "run"), 0.5),
)


def stages_of(settings: Settings) -> tuple[Stage, ...]:
    """The stages of the settings."""
    return tuple(stage for stage in STAGES if stage.quick or not settings.quick)
