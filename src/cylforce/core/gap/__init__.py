"""Diagnosis of the gap between a recording and the model: where it lies, which effect causes it, how far it shrinks."""
