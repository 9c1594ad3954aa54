"""Commands on results: what a file holds, exports, references, this machine."""
