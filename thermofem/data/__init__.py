"""Datasets, tables of measured traces, units, and the files that all of them live in."""
