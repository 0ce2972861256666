"""Supervision of the bus's senders: one node sends each sensor's identifiers, and only our node sends ours."""
