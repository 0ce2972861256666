"""The arithmetic of a step, in a restricted Python that is interpreted as it stands or compiled when a wheel is built.
Work here on what a step costs."""
