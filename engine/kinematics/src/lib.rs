//! URDF to compiled chain: forward kinematics, Jacobian, inverse kinematics.
