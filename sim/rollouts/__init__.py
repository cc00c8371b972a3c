"""Rollouts in bulk: run on any Executor (`run`, `executors`), stored as a dataset (`dataset`)."""
