"""Every number that a decision of the diagnosis rests on, and its origin: physics, convention, a fit by a command."""

# Rows and blocks.
ROWS_HZ = 20.0  # rows a second; physics: four times the band of the service's filters
BLOCK_ROWS = (
    60  # rows of a block, three seconds; convention: longer than the filters' memory, shorter than a working phase
)
POLYNOMIALS = 6  # Legendre polynomials of a block that describe a smooth model discrepancy; convention: down to 0.6 s
MEMORY = 3  # order of the autoregression of the noise floor; fit: higher orders leave the same residual

# Prior probabilities; conventions that the chapter states.
HEALTHY = 0.5  # of a healthy machine
UNKNOWN_EFFECT = 0.1  # of a cause that the library lacks; all names of the library share the remainder
SECOND_EFFECT = 0.1  # of one effect more, beside others
INCIDENT = 0.1  # of an incident (contact, unmeasured slewing, a free torque) in a block
INCIDENT_SIZES = (3.0, 1.0, 0.3, 0.1, 0.03, 0.01)  # sizes of an incident in units of its typical one; half decades
SPILL = 0.01  # of a carried load of which a part falls out, on a healthy machine: one in a hundred

# Spread of nuisances.
PAYLOAD = 4.0  # times 500 kg: standard deviation of an unknown payload
CARRY_BACK = 0.05  # times 500 kg: of what sticks in an empty bucket; physics: 3 to 30 kg a cycle
DISCREPANCY_CHANGE = (
    2.0  # factor: level of the discrepancy from one recording to the next (fit: tools/accuracy decisions)
)
NOISE_CHANGE = 1.4  # factor: scale of the white noise from one recording to the next (the same fit)
TAIL = 0.03  # probability that a joint's residual is nothing that healthy machines show

# Run-to-run variation of a healthy machine, in least plausible magnitudes (table of the ablation in the chapter).
STATIC_CHANGE = 0.02  # of geometry, masses, gains, scales: pins do not move from day to day; the rest is model error
VARYING_CHANGE = 0.2  # of friction and of pressure zeros, which follow the temperature
CREEP_CHANGE = 1.0  # of friction at creep, whose law is the least certain

# Evidence and its strength.
SAME_MACHINE = (
    1.3**2 - 1.0
)  # energy in noise floors by which two recordings of a healthy machine differ (1 +- 0.3 floors)
CORRELATED_ROWS = (
    6.0  # rows of 0.05 s over which model error keeps its value (fit: best log score of tools/accuracy decisions)
)
CLEAR_GAP = 2.0  # noise floors: a gap that healthy machines never show
LAW_ERROR = 0.2  # of a torque: relative error of the best law of an effect
DETECTABLE = 5.0  # standard errors from which on a magnitude is detectable
CREDIBLE = 0.9  # probability that the credible set holds the cause
FEW_BLOCKS = 0.4  # share of the blocks: contact in more of them is the machine's work

# The answer.
HALF = 0.5  # of the gap's energy: what a hypothesis must explain to be one
LEAST_CLOSURE = 0.3  # of the gap's energy: what a named cause must remove once it is simulated
SAME_EVIDENCE = 3.0  # nats: two descriptions of one change that differ by less are one answer (odds of 20)
COSTS = {"missed": 0.5, "unsaid": 0.25, "rival": 0.05, "wrong_set": 0.6}  # in units of a wrong name
NOISY = 3.0  # times its usual noise, or its usual rate of the base: a sensor that is noisy, a base that moves more
