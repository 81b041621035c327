"""The laser stripe of an image."""

from __future__ import annotations

import os
from typing import Any, Literal, Union

from . import _hydroline
from ._call import PathLike
from ._errors import ArgumentError

Orientation = Literal["horizontal", "vertical"]


def extract(
    image: Union[PathLike, Any],
    *,
    whole_pixel: bool = False,
    orientation: Orientation = "horizontal",
) -> "_hydroline.Profile":
    """The laser stripe of an image: one point per column, as ``hydroline extract`` finds it.

    image: a NumPy array of uint8, shape (height, width); in C order it is read where it lies, without a copy (do not
        write to it meanwhile: the GIL is released). Or an image file as ``hydroline extract`` takes it
    whole_pixel: the whole-pixel stripe of the paper instead of the sub-pixel one
    orientation: horizontal = one point per column, vertical = one per row

    Coordinates are pixels; 0 is the centre of the top left pixel, rows grow downwards.

    >>> import numpy
    >>> image = numpy.zeros((480, 640), numpy.uint8)
    >>> image[238:243] = numpy.array([60, 150, 200, 150, 60], numpy.uint8)[:, None]
    >>> profile = extract(image)
    >>> bool(abs(profile.row_px.mean() - 240.0) < 0.05)
    True
    """
    if orientation not in ("horizontal", "vertical"):
        raise ArgumentError(
            f"extract(orientation={orientation!r}): allowed: horizontal, vertical",
            "orientation",
            repr(orientation),
            ("horizontal", "vertical"),
        )
    if not isinstance(whole_pixel, bool):
        raise ArgumentError(
            f"extract(whole_pixel={whole_pixel!r}): a {type(whole_pixel).__name__}; allowed: True or False",
            "whole_pixel",
            repr(whole_pixel),
        )
    if isinstance(image, (str, os.PathLike)):
        return _hydroline.extract_file(image, whole_pixel, orientation == "vertical")
    return _hydroline.extract(image, whole_pixel, orientation == "vertical")
