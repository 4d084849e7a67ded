"""Files in and out: read.py chooses a reader, write.py writes splats, exr.py and png.py write frames."""
