"""CANopen: start-up and supervision of the sensor nodes, and our own node with its SDO server, heartbeat and PDOs.

Work here on the protocol; what the published values mean is decided in service/publication.py.
"""
