"""Files that are whole or absent, and tensors in them."""
