//! Scene inventory and affordance masks from RGB-D geometry alone.
