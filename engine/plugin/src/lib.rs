//! The contracts a plugin implements.
//!
//! Every stage that can be replaced is one trait. Methods take plain views and write into the caller's buffers, so that each
//! contract crosses a C boundary unchanged (`sfg-plugin-abi`). Built-in plugins implement the same traits and register
//! statically, so the default demo loads no library; [`export_pose_generator!`] makes the dynamic form of the same type.
//! [`testing`] has one suite for each contract, run over every implementation.
//!
//! A plugin never sees the simulator's truth: its inputs are sensor data, the vocabulary, the hand profile and calibration.

pub mod contracts;
pub mod export;
pub mod testing;
pub mod views;

pub use contracts::{
    AffordanceQuery, ClosingPlan, Driver, DriverInfo, FunctionalityRequest, GraspPolicy, GraspPolicyState, Grounder, LlmBackend,
    PluginContext, PluginError, PolicyStep, PoseGenerator, PoseRequest, SelfSphere,
};
pub use sfg_plugin_abi as abi;
