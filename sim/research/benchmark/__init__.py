"""Compares methods in drawn worlds: worlds, tables of true rollouts, sessions, summary."""
