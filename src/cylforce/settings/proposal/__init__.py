"""A first machine file from a data sheet: typical proportions of a shipped machine, scaled and fitted."""
