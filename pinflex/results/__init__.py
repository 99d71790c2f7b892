"""What a run leaves behind and what is recovered from it: forces, stresses, comparisons."""
