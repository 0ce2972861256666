"""Commissioning of a new machine: guidance of the operator, identification of the empty machine, lift of a known
weight.

Work here on the required content of a recording, on its acceptance or refusal, and on the identified parameters.
"""
