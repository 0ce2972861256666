"""Effects that begin at some instant of a recording. Work here to add an incident that the diagnosis has to find."""
