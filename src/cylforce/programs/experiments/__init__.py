"""Which motion to record next: a catalogue of motions, and how well each separates the possible causes."""
