"""`cylforce fleet`: the recordings of many machines, on one computer or on a cluster."""
