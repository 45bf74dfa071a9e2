//! Grasp functionality from an embedded knowledge base.
