"""Verification of a finished pretraining, from its folder and true rollouts."""
