"""The one place that joins real parts: from settings to the parts of sessions, calibrations and touch-offs."""
