"""The HMF 2020-K4 loader crane of the University of Agder: its machine file, and what the service makes of its
recordings."""
