"""Pretraining: from a task to a checkpoint, and what that checkpoint is worth."""
