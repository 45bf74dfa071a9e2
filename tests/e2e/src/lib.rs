//! End-to-end tests of the command, and the rules of the workspace.
