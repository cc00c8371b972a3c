"""What commands print with `--json`: one model a command. Every object begins with its `version`."""
