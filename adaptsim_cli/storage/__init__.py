"""What is written is whole or absent, one process at a time: for every folder of the command line."""
