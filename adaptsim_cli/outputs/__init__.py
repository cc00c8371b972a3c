"""The `--json` output of commands: one model per command. Every object begins with its `version`."""
