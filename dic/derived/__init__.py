"""What is made from results: readings of gauges, tables, exports, comparisons and animations."""
