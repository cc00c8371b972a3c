"""What a person reads and types: the terminal, and the texts and tables that several commands share."""
