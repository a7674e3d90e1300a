"""Both studies at a size for a first look, in one self-contained report."""
