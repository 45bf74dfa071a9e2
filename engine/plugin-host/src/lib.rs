//! Registry of built-in plugins; discovery and loading of dynamic libraries.
