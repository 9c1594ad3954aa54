"""Campaigns: many geometries times drives, one netCDF file for each geometry, resumable, on any Executor.

plan    base geometry, what is varied, how it is driven: `Campaign`
vary    one quantity that varies, one drive: `Variation`, `Drive`
schema  the campaign file (TOML)
pool    worker processes that may die
work    one geometry: solved in a worker process, handed back as the bytes of a netCDF file
run     the loop over an Executor
store   the folder: results, failures, and what is finished
collect all results as one Dataset: the index and the training collection
"""

from .collect import open_campaign
from .plan import Campaign, Case
from .run import Summary
from .vary import Drive, Variation

__all__ = ["Campaign", "Case", "Drive", "Summary", "Variation", "open_campaign"]
