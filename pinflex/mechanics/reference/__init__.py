"""The plain evaluator of the equations: Pinocchio and numpy, right before fast; see `equations`."""
