"""The devices of a lab: its file, how they are opened, what they hold, how they see; real or simulated."""
