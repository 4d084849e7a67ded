"""State that the passes of a frame share: context, buffers, uploads, lights."""
