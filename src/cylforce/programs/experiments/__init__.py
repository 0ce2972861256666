"""Which motion to record next: a catalogue of motions, and how well each would tell the candidates apart."""
