"""The arithmetic of a step, in a restricted Python that is interpreted as it is, or compiled when a wheel is built.
Work here on the cost of a step."""
