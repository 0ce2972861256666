"""Object dictionary of our node, and the files made from it: EDS and DBC; reader for the EDS files of sensor vendors.

Work here to add an object or to correct another mistake of vendors' files.
"""
