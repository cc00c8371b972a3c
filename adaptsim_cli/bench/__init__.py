"""Everything around the table: rig file, devices, doctor, calibration, touch-off, single motions."""
