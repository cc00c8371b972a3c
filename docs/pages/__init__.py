"""The pages that follow from the code, one module a page; `docs/generate.py` writes them."""
