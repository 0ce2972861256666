"""Constants on which the diagnosis decides, each with its origin: physics, convention, or a fit by a command.

Constants shared with the examination of readings are in `readings/constants.py`.
"""

# Rows and blocks.
POLYNOMIALS = 6  # Legendre polynomials of a block that describe a smooth model discrepancy; convention: down to 0.6 s
MEMORY = 3  # order of the autoregression of the noise floor; fit: higher orders leave the same residual

# Prior probabilities; conventions that the chapter states.
SECOND_EFFECT = 0.1  # of one effect more, beside others
INCIDENT = 0.1  # of an incident (contact, unmeasured slewing, a free torque) in a block
INCIDENT_SIZES = (3.0, 1.0, 0.3, 0.1, 0.03, 0.01)  # sizes of an incident in units of its typical one; half decades
SPILL = 0.01  # of a carried load of which a part falls out, on a healthy machine: one in a hundred

# Spread of nuisances.
PAYLOAD = 4.0  # times 500 kg: standard deviation of an unknown payload
CARRY_BACK = 0.05  # times 500 kg: standard deviation of carry-back; physics: 3 to 30 kg a cycle
# Factors from one recording to the next (fit: tools/accuracy decisions).
DISCREPANCY_CHANGE = 2.0  # of the level of the model discrepancy
NOISE_CHANGE = 1.4  # of the scale of the white noise
TAIL = 0.03  # probability that a joint's residual is unlike that of healthy machines

# Run-to-run variation of a healthy machine, in least plausible magnitudes (table of the ablation in the chapter).
STATIC_CHANGE = 0.02  # of geometry, masses, gains, scales: pins do not move from day to day; the rest is model error
VARYING_CHANGE = 0.2  # of friction and of pressure zeros, which follow the temperature
# Friction with oil of another temperature, relative to its magnitude, by the names of the parameters; physics: the
# viscosity of ISO VG 46 is five times as large at 10 degC as at 40, dry friction and return pressure twice.
OIL_CHANGE = {"viscous": 3.0, "coulomb": 1.0, "load_dependent": 1.0, "directional": 1.0}
OWN_OIL_CHANGE = 0.4  # of that: each cylinder's own part; physics: friction follows the viscosity to the 0.45 to 0.75th
# Zero [Pa] of a pressure sensor at another temperature; data sheets: 0.01 to 0.1 % of 400 bar for every 10 K, 30 K.
THERMAL_ZERO = 0.5e5
CREEP_CHANGE = 1.0  # of friction at creep, whose law is the least certain

# Evidence and its strength.
# Energy in noise floors by which two recordings of a healthy machine differ (1 +- 0.3 floors).
SAME_MACHINE = 1.3**2 - 1.0
# Rows of 0.05 s over which model error keeps its value (fit: best log score of tools/accuracy decisions).
CORRELATED_ROWS = 6.0
VISIBLE = 2.5**2 - 1.0  # energy in noise floors of the smallest gap that counts as visible; convention
DETECTABLE = 5.0  # standard errors from which on a magnitude is detectable
FEW_BLOCKS = 0.4  # share of the blocks: contact in more of them is the machine's work

# The answer.
LEAST_SHARE = 0.3  # of an unexplained residual's energy that a curve must predict to be reported; convention
SAME_EVIDENCE = 3.0  # nats: two descriptions of one change that differ by less are one answer (odds of 20)
COSTS = {"missed": 0.5, "unsaid": 0.25, "rival": 0.05, "wrong_set": 0.6}  # in units of a wrong name
