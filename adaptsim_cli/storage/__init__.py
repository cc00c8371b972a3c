"""Durable storage for all folders of the command line: files are whole or absent, and one process writes at a time."""
