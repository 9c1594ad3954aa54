"""Package version. It is stored in every file and is part of the hash of every campaign result."""

__version__ = "0.3.0"
