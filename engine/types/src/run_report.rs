//! What a run decided, why, and how it was judged.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// One stage of the data path, as it went.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct StageRecord {
    /// Name of the skill node, for example `select_palm_pose`.
    pub stage: String,
    /// Time on the driver's clock when it ended.
    pub stamp_secs: f64,
    /// `None` = it succeeded.
    pub failure: Option<crate::FailureReason>,
    /// One line for the user: what was decided and why.
    pub summary: String,
    /// SHA-256 of what the stage decided on, hexadecimal.
    pub input_sha256: String,
    /// Everything else worth keeping, by name.
    pub details: serde_json::Value,
}

/// One predicate of the scenario, judged.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct PredicateResult {
    /// Name and arguments as in the scenario, for example `grains_in`.
    pub predicate: String,
    /// `truth` (simulator) or `sensed` (driver signals).
    pub evaluator: String,
    /// Does it hold.
    pub passed: bool,
    /// What was measured, for the reader.
    pub measured: String,
}

/// How a run ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// The tree succeeded and every truth predicate holds.
    Success,
    /// The tree succeeded, a predicate does not hold.
    JudgedFailure,
    /// The tree failed.
    TreeFailure,
    /// The backend asked or refused.
    NotAttempted,
    /// The user or an emergency stop ended the run.
    Interrupted,
    /// The judge found the physics manipulated.
    PhysicsTampered,
}

/// The report of one run: the same bytes for the same seed, but for `timings`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RunReport {
    /// Version of this layout.
    pub schema_version: u32,
    /// Scenario name.
    pub scenario: String,
    /// SHA-256 of the scenario file.
    pub scenario_sha256: String,
    /// Version of the engine.
    pub engine_version: String,
    /// Seed of the run.
    pub seed: u64,
    /// What the user said.
    pub instruction: String,
    /// How it ended.
    pub outcome: Outcome,
    /// Failure of the tree: reason, node path, explanation.
    pub failure: Option<RunFailure>,
    /// The scenario's success predicates.
    pub predicates: Vec<PredicateResult>,
    /// What the judge saw beyond the predicates; absent without a simulator.
    pub judge: serde_json::Value,
    /// The stages in the order in which they ended.
    pub stages: Vec<StageRecord>,
    /// What the safety filter changed.
    #[serde(default)]
    pub safety: SafetyReport,
    /// Length of the run on the driver's clock.
    pub duration_secs: f64,
    /// Wall-clock measurements; the only part that differs between equal runs.
    pub timings: serde_json::Value,
}

/// What the safety filter did in a run.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct SafetyReport {
    /// Control periods in which a set point was sent.
    pub periods: u64,
    /// Set points that were changed.
    pub interventions: u64,
    /// The same by the limit that would have been broken.
    pub by_limit: BTreeMap<String, u64>,
    /// The first one, for people.
    pub first: Option<String>,
}

/// Why a tree failed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RunFailure {
    /// Reason from the closed list, or the tree's own (`panicked`).
    pub reason: String,
    /// Path of the failing node.
    pub node: String,
    /// One sentence.
    pub explanation: String,
}
