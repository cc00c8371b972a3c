"""A robot of one's own as a target: adaptsim asks for trials, and a program, a person or Python answers."""
