"""Methods that adaptation is compared with."""
