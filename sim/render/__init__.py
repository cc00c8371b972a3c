"""Ray casting of triangle meshes on the CPU, and what a depth sensor makes of it."""
