"""What a finished pretraining is worth, from its folder and true rollouts."""
