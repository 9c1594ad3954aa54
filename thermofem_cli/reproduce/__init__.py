"""``thermofem reproduce``: the paper from our own FEM, stage by stage, into one report.

The paper is M. Borghi, D. Bazzanella, M. Mancinelli, L. Pavesi, Opt. Express 29, 4363 (2021). Nothing is taken from a
laboratory: the ring coupled to the finite elements plays the experiment.
"""

from .run import run
from .settings import Settings

__all__ = ["Settings", "run"]
