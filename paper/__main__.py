"""``python -m paper -o out``: compute what is missing, draw everything, and write out/report.html.

The exit code is 1 where a row of the report has no number.
"""

import argparse
import sys
from pathlib import Path

from .report.runner import run

if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--output", type=Path, default=Path("out"), help="folder to write")
    parser.add_argument("--quick", action="store_true", help="the one-minute version: no maps, no FEM in the loop")
    parser.add_argument("--threads", type=int, help="worker processes; default: one for each CPU")
    given = parser.parse_args()
    made = run(given.output, quick=given.quick, workers=given.threads)
    sys.exit(1 if made["incomplete"] else 0)
