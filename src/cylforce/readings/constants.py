"""Every number that a decision on readings rests on, with its origin: physics, a convention, or a fit by a command."""

# Prior probabilities; conventions that the chapter of the diagnosis states.
HEALTHY = 0.5  # of a healthy machine
UNKNOWN_EFFECT = 0.1  # of a cause that the library lacks; all names of the library share the remainder
CREDIBLE = 0.9  # probability from which on one of several possibilities counts as certain
SURE = 0.8  # probability from which on a cause is named alone: a name then costs less than "unknown"

# Sizes.
HALF = 0.5  # of the energy, or of the samples: the most of it
CLEAR_GAP = 2.0  # noise floors: a difference that healthy machines never show
NOISY = 3.0  # times the usual noise; convention: nine times the power, twice would name sensors that are merely poor
JUMPS_HZ = (1.0 / 86400.0, 0.5)  # rate of jumps, log-uniform: once a day to every other second; physics: loose contacts
FALSE_LINES = 0.01  # lines of a spectrum that noise alone would show in a diagnosis; convention

# Rows.
ROWS_HZ = 20.0  # rows a second; physics: four times the band of the service's filters
BLOCK_ROWS = 60  # rows of a block, three seconds; convention: longer than the filters' memory, shorter than a phase
LOAD_CENTRE = (
    300.0,
    300.0,
    600.0,
)  # spread of a load's first moments [kg m] and inertia [kg m^2]: 0.5 m, 600 kg
