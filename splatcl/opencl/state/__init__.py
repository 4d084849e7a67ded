"""State that the passes of a frame share: context, records, uploaded splats, lights."""
