"""The commands that pretrain, verify checkpoints and compare methods, with their pages."""
