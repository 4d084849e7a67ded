"""Errors that a user can cause and mend; the command line prints each as one line."""


class SplatclError(ValueError):
    """An input cannot be used; the message names the place, the problem and the remedy."""


class FileError(SplatclError):
    """A file cannot be read or written; the message starts with its path."""


class InvalidSplatsError(SplatclError):
    """Splats, points or triangles are non-finite or degenerate, or an array has a wrong shape."""


class DeviceError(SplatclError):
    """There is no usable OpenCL device, or the device cannot build or run a kernel."""


class CameraError(SplatclError):
    """A camera's numbers contradict each other or are out of range."""


class SettingsError(SplatclError):
    """A setting or an argument has an unknown value, is out of range, or contradicts another one."""


class CheckError(RuntimeError):
    """A check of a render failed: a defect of splatcl or of the device, not a user's mistake."""
