"""Deterministic generators of the project scenes' meshes (numpy only)."""
