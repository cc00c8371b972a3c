"""The one place that joins real parts: from settings to what sessions, calibrations and touch-offs are run with."""
