"""The CAN bus and the clock: the only place where frames are sent and received and time is read.

Work here to add a bus interface or to change time stamps.
"""
