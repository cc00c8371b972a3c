"""One lab with a real arm: the file that describes it, and its devices joined for a session."""
