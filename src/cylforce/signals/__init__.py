"""Values that all rooms share: events, signals, PDO layouts and their codec, samples, estimates, units.

Work here to add a kind of signal, a published value or a reason why a value is withheld. Imports nothing of cylforce.
"""
