"""The file that describes a real lab: read, explained, and written by asking."""
