"""The version: in every file that is written, and in the key of every result of a campaign."""

__version__ = "0.2.0"
