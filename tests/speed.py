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
    """Whether `took_s()`, a processor time [s], keeps to the goal in one of a few tries, each between two imports of
    numpy. Other programs make it longer, never shorter; what is too slow itself is so in each of them."""
    tries = []
    for _ in range(TRIES):
        before = processor_s("-c", "import numpy")
        took = took_s()
        here = (before + processor_s("-c", "import numpy")) / 2.0
        tries.append(took * IMPORT_S / here)
        if 0.0 < tries[-1] <= goal_s:
            return True
    print(f"goal: {goal_s} s; taken: {', '.join(f'{each:.3f} s' for each in tries)}")
    return False
