"""The file that describes a real lab: read, explained, and written from an interview."""
