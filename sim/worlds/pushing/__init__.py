"""Worlds of pushing."""
