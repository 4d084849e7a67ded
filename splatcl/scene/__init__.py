"""The input of a render: splats, camera, lights, settings."""
