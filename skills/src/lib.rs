//! Skills in the order of the data path, each a pure function and a thin tree node.
