"""Adaptation: from trials to the next simulation parameters."""
