"""The stages of a reproduction, in order."""

from __future__ import annotations

from . import (
    carrier_stages,
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
TRAINED = ("elements", "training", "fits")
LOOP = ("accuracy", "run")
MAPS = ("grid", "duration")
STAGES = (
    Stage("elements", "finite elements and their reduction", heat_stages.elements, (), FEM, 1, quick=True),
    Stage("stacks", "the ring in other stacks", heat_stages.stacks, (), FEM, 5, aside=True),
    Stage("hot", "k(T) and c_p(T)", heat_stages.hot, (), FEM, 3, aside=True),
    Stage("pulse", "Fig. 5(a): 20 µs pulse", heat_stages.pulse, (), FEM, 2, quick=True),
    Stage("squares", "square waves of 1 and 0.8 µs", heat_stages.squares, (), FEM, 2, quick=True),
    Stage("training", "training on the FEM", training_stages.training, ("elements", "squares"), FEM, 4, quick=True),
    Stage("drives", "training on other drives", training_stages.drives, ("elements",), FEM, 3),
    Stage("ring", "the ring's own numbers", paper_stages.ring, ("elements",), (), 0.2, quick=True),
    Stage("carriers", "Fig. 3(b): carrier lifetime", carrier_stages.carriers, (), (), 0.2, quick=True),
    Stage("periods", "Fig. 7: period error", training_stages.periods, ("elements", "training"), FEM, 1, quick=True),
    Stage("traces", "self-pulsing at (8 dBm, 0 GHz)", pulsing_stages.traces, TRAINED[:2], (), 2, quick=True),
    Stage("runs", "the paper's own models", paper_stages.runs, (), (), 1, aside=True),
    Stage("readings", "the print at its word", paper_stages.readings, (), ("grid",), 3, aside=True),
    Stage("heating", "Fig. 5(b): the heat of self-pulsing", pulsing_stages.heating, (), (*FEM, "cycle"), 7, aside=True),
    Stage(
        "stacks_explained", "stacks that explain the experiment", stack_stages.explained, (), ("cycle",), 15, aside=True
    ),
    Stage("loop", "FEM in the loop", loop_stages.loop, ("elements",), (*LOOP, "fitted"), 15),
    Stage(
        "loop_map",
        "FEM in the loop: a map",
        loop_stages.loop_map,
        ("elements",),
        (*LOOP, "grid", "loop_every"),
        40,
        aside=True,
    ),
    Stage("fits", "Fig. 4(d): models fitted to traces", pulsing_stages.fits, ("loop",), ("runs",), 25),
    Stage("marked", "Figs. 4(c) and 6(c): traces", pulsing_stages.marked, TRAINED, ("run",), 2),
    Stage("maps", "Figs. 4 and 6: maps", map_stages.maps, (*TRAINED, "periods"), MAPS, 24),
    Stage("scan", "Fig. 4: would any Newton's law do?", map_stages.scan, ("maps",), ("scan",), 12),
    Stage("rings", "Fig. 7: two rings", map_stages.rings, ("elements", "fits"), MAPS, 3),
    Stage("cost", "what each model costs", pulsing_stages.cost, (*TRAINED, "loop"), ("repeats", "run"), 1),
)


def stages_of(settings: Settings) -> tuple[Stage, ...]:
    """The stages of the settings."""
    return tuple(stage for stage in STAGES if stage.quick or not settings.quick)
