"""Pretraining: from a task to a checkpoint, and its evaluation."""
