"""Errors that a user can cause and mend; the command line prints them as one line."""


class SplatclError(ValueError):
    """Something the user gave cannot be used; the message names what, where and the remedy."""


class FileError(SplatclError):
    """A file cannot be read or written; the message starts with its path."""


class InvalidSplatsError(SplatclError):
    """Splats are non-finite, degenerate or of the wrong shape."""


class DeviceError(SplatclError):
    """No usable OpenCL device, or the device refused to build or run a kernel."""


class CameraError(SplatclError):
    """A camera's numbers contradict each other or the specification."""


class SettingsError(SplatclError):
    """A render setting has no meaning or no such value."""


class CheckError(RuntimeError):
    """A render did not add up; this is a defect, not a user's mistake."""
