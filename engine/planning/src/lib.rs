//! Collision model, path planner, time parameterisation and command limits.
