"""Errors of models against a reference, and which model suffices where."""
