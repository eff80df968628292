"""What a solver's library prints does not reach stdout, which belongs to results."""

from __future__ import annotations

import subprocess
import sys

LOUD = """
import os, highspy
real, greeted = highspy.Highs, []
class Loud(real):
    def __init__(self):
        if not greeted:
            os.write(1, b"a banner\\n")
            greeted.append(True)
        super().__init__()
highspy.Highs = Loud
from jld_core import samples, build_assembly, solve
print(solve(build_assembly(samples.wall(courses=2, length=0.8)), solver="highs").status, greeted)
"""


def test_a_banner_of_highs_is_not_on_stdout() -> None:
    """HiGHS 1.16 greets whoever makes the first instance, before it can be told to be silent."""
    done = subprocess.run([sys.executable, "-c", LOUD], capture_output=True, text=True, check=True)
    assert done.stdout == "collapse [True]\n"
