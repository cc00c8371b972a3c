"""Recorded trials read from a folder: tables, MCAP files of others, or a session of this program."""
