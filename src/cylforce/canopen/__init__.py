"""CANopen: start-up and supervision of the sensor nodes, and our own node with its SDO server, heartbeat and PDOs.

Work here on the protocol; the meaning of the published values is defined in service/published_values.py.
"""
