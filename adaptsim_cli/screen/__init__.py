"""The terminal: output, questions, and texts and tables that several commands share."""
