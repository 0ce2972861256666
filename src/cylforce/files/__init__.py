"""Files of recordings: event log (candump text), tables (CSV, Parquet), ground truth, and safe writing.

Work here to add a file format.
"""
