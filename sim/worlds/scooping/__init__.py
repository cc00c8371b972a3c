"""Worlds of scooping."""
