//! The C boundary of a plugin: repr(C) types only.
