"""``splatcl paper``: the papers' claims, rerun; each experiment measures what a figure or a table shows."""
