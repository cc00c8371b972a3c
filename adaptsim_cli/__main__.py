"""`python -m adaptsim_cli`, the same as `adaptsim`."""

from adaptsim_cli.commands.app import main

if __name__ == "__main__":
    main()
