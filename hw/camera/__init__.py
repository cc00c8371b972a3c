"""RGB-D cameras, each behind `hw.ports.Camera`."""
