//! YAML scenarios: parsed with positions, checked as a whole, built into a tree.
