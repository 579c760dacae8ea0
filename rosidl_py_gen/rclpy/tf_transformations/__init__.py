"""Rotations and homogeneous matrices; without transforms3d. Quaternions are x, y, z, w, angles radians."""

from tf_transformations.arcball import *  # noqa: F403
from tf_transformations.matrices import *  # noqa: F403
from tf_transformations.rotations import *  # noqa: F403
from tf_transformations.rotations import _AXES2TUPLE as _AXES2TUPLE
from tf_transformations.rotations import _NEXT_AXIS as _NEXT_AXIS
from tf_transformations.rotations import _TUPLE2AXES as _TUPLE2AXES
from tf_transformations.vectors import *  # noqa: F403
from tf_transformations.vectors import _EPS as _EPS
