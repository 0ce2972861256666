"""The withheld trial: an effect is hidden in recordings of a reference machine, `cylforce gap` diagnoses them without
its name, and the answer is compared with the truth. See `__main__`."""
