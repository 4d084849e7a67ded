"""Structs: the device's layout is NumPy's, and any other layout does not compile."""

from __future__ import annotations

import numpy as np
import pytest

from splatcl.errors import DeviceError
from splatcl.opencl.device import structs as layout
from splatcl.opencl.device.devices import choose_device
from splatcl.opencl.device.queue import Program

REALS = ["f4"] + ["f8"] * (choose_device().supports["double"] == "yes")


@pytest.mark.parametrize("real", REALS)
def test_the_device_lays_structs_out_as_numpy_does(device, real):
    from pyopencl.tools import match_dtype_to_c_struct

    for name, dtype in layout.structs(real)[0].items():
        fields = np.dtype(layout._fields(real)[name])
        assert match_dtype_to_c_struct(device.info.handle, name, fields)[0] == dtype


@pytest.mark.parametrize("real", ["f4", "f8"])
def test_a_struct_is_padded_at_its_end_only(real):
    for dtype in layout.structs(real)[0].values():
        ends = np.cumsum([dtype[name].itemsize for name in dtype.names])
        assert [dtype.fields[name][1] for name in dtype.names] == [0, *ends[:-1]]


def test_another_layout_does_not_compile(device):
    declarations = layout.structs("f4")[1]
    options = {"LANES": 1, "DOUBLE": 0, "EXACT_DIVIDE": 1, "EXACT_SQRT": 1, "ON_POCL": 0, "ORTHOGRAPHIC": 0}
    options |= {"SHADER": '"shading/shaders/phong.h"', "RESOLVED": 0}
    with pytest.raises(DeviceError, match="View_size"):
        Program(device.context, "passes/shade.cl", declarations.replace("float near;", ""), options)
