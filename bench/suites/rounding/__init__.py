"""The suite `rounding`: digits that are above rounding, and the stages that lose the others."""
