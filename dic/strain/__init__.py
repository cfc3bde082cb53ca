"""From displacements to strain, with its standard deviation."""
