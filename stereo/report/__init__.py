"""The tables, the charts and the page of an evaluation."""
