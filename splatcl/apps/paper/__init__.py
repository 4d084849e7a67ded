"""``splatcl paper``: rerun the papers' claims; each experiment measures the content of a figure or a table."""
