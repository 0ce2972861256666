"""Processor time on any computer: in seconds of one that imports numpy in a tenth of a second.

The goals of the project are in seconds of such a computer. Another one, or one whose neighbours take its caches and its
clock, is as much slower at both."""

import resource
import subprocess
import sys

IMPORT_S = 0.1
TRIES = 5


def processor_s(*words):
    """Processor time of one run of Python with these words [s]."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, *words], capture_output=True, check=True, timeout=60)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime


def takes_at_most(goal_s, took_s):
    """Whether `took_s()`, a processor time [s], keeps to the goal: the shortest of a few tries, beside the shortest of
    as many imports of numpy. Other programs make both longer, never shorter."""
    imports, took = [processor_s("-c", "import numpy")], []
    for _ in range(TRIES):
        took.append(took_s())
        imports.append(processor_s("-c", "import numpy"))
        if 0.0 < min(took) * IMPORT_S <= goal_s * min(imports):
            return True
    print(f"goal: {goal_s} s where numpy is imported in {IMPORT_S} s; {took} s here, where it is in {imports} s")
    return False
