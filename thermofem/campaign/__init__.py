"""Campaigns: many geometries times drives, one netCDF file for each geometry, resumable, on any Executor.

variations     one quantity that varies, one drive
plan           base geometry, what is varied, how it is driven: `Campaign`
campaign_file  the same as TOML
run            the loop over the geometries
workers        processes of our own, or any Executor
store          finished results of any long job: a file for each key, and its hash
collection     the folder, and all results as one Dataset
"""

from .campaign_file import Drive, Variation
from .campaign_run import Summary
from .collection import open_campaign
from .plan import Campaign, Case

__all__ = ["Campaign", "Case", "Drive", "Summary", "Variation", "open_campaign"]
