"""Choice of the motion to record next: a catalogue of motions, and their separation of the possible causes."""
