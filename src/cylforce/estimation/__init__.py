"""The numerical part: filters, regressor, batch and recursive least squares, and the model of the empty machine.

Work here on accuracy, standard errors and speed of the estimation. Service, commissioning and diagnosis all use it.
"""
