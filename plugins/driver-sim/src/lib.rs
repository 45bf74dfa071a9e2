//! The built-in simulator behind the driver contract.
