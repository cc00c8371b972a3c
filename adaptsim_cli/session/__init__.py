"""A session: the questions, steps and records of every trial and iteration."""
