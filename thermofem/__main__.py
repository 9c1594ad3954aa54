"""``python -m thermofem``: the command ``thermofem``."""

import runpy

runpy.run_module("thermofem_cli", run_name="__main__", alter_sys=True)
