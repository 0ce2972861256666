"""The machine file and the file of identified parameters: reading, checking, conversion to SI, clear error messages.

Work here to add a key to the machine file or a check of its values.
"""
