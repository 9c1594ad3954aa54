"""Traces of one ring in time: integration, record, and the regime that a trace ends in."""
