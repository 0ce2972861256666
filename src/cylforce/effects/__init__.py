"""Floor 2: physical causes of force, each written once; simulated and regressed by the same columns.

An effect gives its columns in two halves, momentum and static, both (..., N joints, P parameters) in torque form.
Simulating it is d/dt(momentum @ value) + static @ value; regressing it is w (momentum - L momentum) + L static.
Siblings never import each other.
"""
