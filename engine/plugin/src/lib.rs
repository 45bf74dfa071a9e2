//! The contracts a plugin implements.
//!
//! Every stage that can be replaced is one trait. Methods take plain views and write into the caller's buffers, so that each
//! contract crosses a C boundary unchanged (`sfg-plugin-abi`). Built-in plugins implement the same traits and register
//! statically, so the default demo loads no library.
//!
//! A plugin never sees the simulator's truth: its inputs are sensor data, the vocabulary, the hand profile and calibration.

pub mod contracts;

pub use contracts::{
    AffordanceQuery, ClosingPlan, Driver, DriverInfo, FunctionalityRequest, GraspPolicy, GraspPolicyState, Grounder,
    LlmBackend, PluginContext, PluginError, PolicyStep, PoseGenerator, PoseRequest, SelfSphere,
};
