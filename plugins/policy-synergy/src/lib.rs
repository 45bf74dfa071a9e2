//! Closing along the synergy of the grasp type, stopped by motor current.
