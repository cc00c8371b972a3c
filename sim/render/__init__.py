"""Ray casting of triangle meshes on the CPU, and a model of the depth sensor."""
