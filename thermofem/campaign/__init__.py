"""Campaigns: many geometries times drives, one netCDF file for each geometry, resumable, on any Executor.

campaign       base geometry, what is varied, how it is driven, and the loop over the geometries: `Campaign`
campaign_file  varied quantities and drives, and the same as TOML
collection     the folder, and all results as one Dataset
stored_tasks   worker processes, or any Executor; finished results of any long job, each with a hash
"""

from .campaign import Campaign, Case, Summary
from .campaign_file import Drive, Variation
from .collection import open_campaign

__all__ = ["Campaign", "Case", "Drive", "Summary", "Variation", "open_campaign"]
