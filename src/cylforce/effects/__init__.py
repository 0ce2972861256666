"""Physical causes of force and of measurement error, one file each, and the library that the diagnosis tries.

Work here to add an effect. An effect gives its columns in two halves, momentum and static, both (..., N joints, P
parameters) in torque per parameter. The simulation computes d/dt(momentum @ value) + static @ value. The regression
computes w (momentum - L momentum) + L static, with L a first-order low-pass of cut-off w. Both use the same columns.
"""
