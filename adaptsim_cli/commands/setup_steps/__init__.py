"""`adaptsim setup`: one walk from an unpacked arm to the first trial. Start at `walk`."""
