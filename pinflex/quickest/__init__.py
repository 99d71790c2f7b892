"""The shortest motion that keeps limits and does not shake."""
