"""The command line: ``thermofem solve | campaign | fit | reduce | validate | simulate | cosimulate | map | ...``.

This package is the only one that imports thermofem, surrogate and coupled at once, and nothing imports it. A command
is a function in a file ``NAME_command.py``, beside the others of its subject: `thermal` has those on heat and its
models, `light` those on rings; those on any result stand here. To add one:

1. Write the function. Its parameters are the arguments and options, its docstring is the text of --help. What several
   commands share is declared in `options`, and so are the five options that every command has (--json .. --threads; a
   command declares ``seed`` where it draws at random). Matplotlib alone is imported inside the function.
   `command_files.check_outputs` comes before the work. Results are printed by `console.say`, hints by `console.note`,
   names of written files by `console.wrote`; all numbers are returned in SI as a dict, which --json prints. An
   InputError names the option, the value and the rule.
2. Add one line to ``COMMANDS`` in `app`, and run ``python docs/generate.py``, which writes docs/commands.md.
"""

from .app import app, main

__all__ = ["app", "main"]
