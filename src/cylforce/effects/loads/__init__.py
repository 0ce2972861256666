"""Weight, inertia and outside forces on the links, one file each. Work here to add a load or a force."""
