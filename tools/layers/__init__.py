"""Layers of a diagnosis that decide, and the evidence that they are compared on (see studies.decisions)."""
