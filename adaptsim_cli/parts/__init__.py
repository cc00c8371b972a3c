"""Parts to print for a lab: solids from the numbers of the scenes, and a sheet with their drawings."""
