"""The equations of a mechanism at given states."""
