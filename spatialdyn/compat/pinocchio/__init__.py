"""The library under the names and conventions of Pinocchio: ``import spatialdyn.compat.pinocchio as pin``.

Vectors are [linear; angular]; a free flyer has q = [x y z, quaternion x y z w] and v in its own axes; continuous
joints have q = [cos, sin]; external forces are given in the joints' own frames. What differs from Pinocchio on purpose
is listed in ``differences``.
"""

from __future__ import annotations

from .builders import buildModelFromUrdf, buildModelFromXML
from .frame import (
    ACCELERATION,
    ARG0,
    ARG1,
    ARG2,
    ARG3,
    ARG4,
    BODY,
    FIXED_JOINT,
    JOINT,
    LOCAL,
    LOCAL_WORLD_ALIGNED,
    OP_FRAME,
    POSITION,
    SENSOR,
    VELOCITY,
    WORLD,
    ArgumentPosition,
    Convention,
    Frame,
    FrameType,
    KinematicLevel,
    ReferenceFrame,
)
from .inertia import Inertia
from .joints import (
    JointModel,
    JointModelPrismaticUnaligned,
    JointModelPX,
    JointModelPY,
    JointModelPZ,
    JointModelRevoluteUnaligned,
    JointModelRevoluteUnboundedUnaligned,
    JointModelRUBX,
    JointModelRUBY,
    JointModelRUBZ,
    JointModelRX,
    JointModelRY,
    JointModelRZ,
)
from .joints_many import (
    JointModelComposite,
    JointModelFreeFlyer,
    JointModelMimic,
    JointModelPlanar,
    JointModelSpherical,
    JointModelSphericalZYX,
    JointModelTranslation,
    JointModelUniversal,
)
from .model import Model
from .motion import Force, Motion
from .se3 import SE3
