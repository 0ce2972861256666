"""What the readings of a recording show by themselves, before any model of a fault: clocks that differ, sensors that
are frozen or exchanged, jumps, noise, vibration, and references that are unlike the others."""
