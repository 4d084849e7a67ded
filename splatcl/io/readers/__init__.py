"""Readers, one file for each format; io/read.py chooses among them."""
