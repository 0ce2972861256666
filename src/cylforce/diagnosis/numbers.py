"""Every number that a decision of the diagnosis rests on, and where it comes from: physics, a convention, or a fit by a
command (of one number here, of many in `learnt.py`). Nothing else in this folder decides by a number of its own."""

# Prior probabilities: conventions, said in the chapter.
IN_ORDER = 0.5  # that the machine is in order
ODD = 0.1  # that what is wrong is nothing the library has; the rest is shared by all names, then by places and forms
SECOND = 0.1  # that one more effect is there beside a first
HAPPENS = 0.1  # that something happens in a block of three seconds
USUAL_SIZES = (3.0, 1.0, 0.3, 0.1, 0.03, 0.01)  # of that, in one block, each as probable (convention: half decades)
HEAVY = 4.0  # times an unusual change of a load, 500 kg: what may hang in the bucket of a machine at work (convention)
STICKS = 0.05  # of the same: what sticks in an empty bucket (3 to 30 kg a cycle: physics)
FALLS = 0.01  # that a part falls out of a load that is carried on, of a machine in order: one in a hundred (convention)
TAIL = 0.03  # that a joint's discrepancy is nothing that machines in order show: 3 % (an earlier prototype, kept)

# Everyday change from one recording to another, standard deviation of a logarithm (fit: study of the decisions).
LEVEL_CHANGE = 2.0  # times: level of the smooth discrepancy
SCALE_CHANGE = 1.4  # times: scale of the noise

# A discrepancy that no reference shows: the level of the noise, and three times as uncertain (convention).
UNSEEN = 1.0
UNSURE = 3.0

# Of the floor's energy: one reference predicted from another leaves 1 +- 0.3 floors (`tests/test_gap_floor.py`).
SAME = 1.3**2 - 1.0

# Everyday differences from one recording to another, of an effect's least plausible size.
USUALLY = 0.2  # convention: learnt ones trade weak effects for false alarms (measured, see the chapter)
AT_CREEP = 1.0  # of friction that shows at creep: learnt alike on two generators (`tools/accuracy decisions --learn`)
RUN_TO_RUN = ("coulomb_friction", "friction_level_change", "pressure_offset")  # learnt from a machine's own references
# Of a sampling period: how far pressures and angles of different nodes are apart, each anything up to a period old when
# it is taken (physics: standard deviation of the difference of two uniform numbers). From start to start it is another.
AGES = 6.0**-0.5
FROM_START_TO_START = ("clock_fault",)  # references of one start show nothing of it, so that it is not learnt from them
EVERYDAY = {"stribeck": AT_CREEP, "presliding_hysteresis": AT_CREEP}

# Of those, how large one machine's are: as stated, a half, a quarter; each as probable. Convention: steps of a factor
# of two, as for the level of the discrepancy; smaller ones were never the likeliest (study of the decisions).
STEADY = (1.0, 0.5, 0.25)

# What a data sheet does not know, dry friction and where the masses are: there as probably as not. Beside it only what
# else an identification determines is asked of a machine that nobody identified: sensors cannot be told from the sheet.
EXPECTED = ("coulomb_friction", "first_moment_change")
IDENTIFIED = (*EXPECTED, "viscous_friction", "load_dependent_friction", "asymmetric_friction")

# Noise of a sensor, of the larger of what it declares and what its references show; how fast a base turns, of how fast
# it turned in the references: convention (three times is 9 times the power; twice would tell a sensor that is only
# worse than its data sheet).
SHAKES = 3.0

# Lines of a spectrum that noise alone would show in a diagnosis: fewer, and it is vibration (convention).
VIBRATES = 0.01

# Rate of jumps of a reading, log-uniform: from once a day to every other second, as with a loose contact (physics).
GLITCHES_PER_S = (1.0 / 86400.0, 0.5)

# The answer: conventions.
SIGMAS = 5.0  # standard errors from which on an effect is detectable
MASS = 0.9  # probability that the set of causes holds
HALF = 0.5  # of the gap's energy beyond the floor: what a hypothesis must explain to be one, the most of it
SLIGHT = 0.3  # of the gap's energy: what is named must take away that much when it is simulated, as far as can be told
SELDOM = 0.4  # of all blocks: contact in more of them is the machine's work, and no effect of its own
ALIKE = 3.0  # nats: a mass and a first moment of one link that differ by less are one answer (convention: odds of 20)
GAP = 2.0  # times the floor, rms: a gap that is never called none
LAW = 0.2  # of a torque: how far the true law may be from the one written (as `About.form` of friction: convention)

# Rows of 0.05 s for which a torque that nothing explains stays what it is (fit: of 1 to 100 the best log score of the
# study of the decisions).
HOLDS = 6.0

# The share of the gap's energy that goes, once simulated.
RATIO = 0.1  # of the floor's energy: a smaller gap has no meaningful share (convention)
WIDEST = 0.2  # an interval wider than that says nothing: no share is given (convention)
UNTOLD = (0.03, 0.01)  # by which it lies lower, higher than drawn blocks tell (fit: trial, development machines)

# Where the gap is: conventions.
FALSE = 0.05  # share of false discoveries
MARGIN = 2.0  # times the energy, by which the same machine may differ from itself: conditions of two days are not one's

# A base that moves, by its tilt sensor.
STANDING = 5e-4  # rad/s, rms: what stands turns as fast (physics: noise of such sensors, filtered)

# Costs of an answer, in units of a wrong name (conventions).
MISSED = 0.5  # "no gap" where there is one
UNSAID = 0.25  # "unknown" where the cause could have been named
SURE = 1.0 / (1.0 + UNSAID)  # of one name alone: where a name costs less than "unknown" though there surely is a gap
SET = 0.05  # a set that holds the cause, for each rival that is checked until it is found
EMPTY_SET = 0.6  # a set that does not
