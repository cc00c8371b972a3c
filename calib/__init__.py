"""Camera-to-base calibration."""
