"""What is known of the parameters before a recording: from the data sheet, the linkages and the links' depth."""
