"""The withheld trial: recordings of reference machines with a hidden effect, a diagnosis that does not see which, and
what comes of comparing the two. See `__main__`."""
