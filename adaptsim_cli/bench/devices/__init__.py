"""The devices of a lab: the rig file, opening, confirmation, trackers."""
