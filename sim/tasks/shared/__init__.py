"""What several tasks are built with."""
