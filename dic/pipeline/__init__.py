"""From images or a run to results: the order in which everything is done."""
