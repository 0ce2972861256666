"""The verdict, the causes simulated, where the gap is and what shape it has."""
