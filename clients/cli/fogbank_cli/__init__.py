"""The command `fogbank`: one module per noun or verb, on top of the Python package."""
