"""Diagnosis of the difference between a machine and its model (`cylforce gap`): which effect explains what remains.

Work here on how effects are ranked, confirmed and reported.
"""
