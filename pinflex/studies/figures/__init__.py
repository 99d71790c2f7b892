"""Figures of studies that are no results by themselves."""
