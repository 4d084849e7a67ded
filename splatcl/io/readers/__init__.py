"""Readers, one module for each format; io/read.py chooses one."""
