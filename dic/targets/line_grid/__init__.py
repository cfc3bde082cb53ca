"""The paper's target: a grid of lines, found and measured at its crossings."""
