"""Rows of the validation page: what tests have measured joins what is there."""

from __future__ import annotations


def merged(old, new, *, drop):
    """Old rows in their order with what the new ones say, then the rest of the new; and what nothing measured."""
    fresh = {(row["subject"], row["what"]): row for row in sorted(new, key=lambda row: (row["subject"], row["what"]))}
    left = [row for row in old if (row["subject"], row["what"]) not in fresh]
    rows = [fresh.pop((row["subject"], row["what"]), row) for row in old if not (drop and row in left)]
    return [*rows, *fresh.values()], left
