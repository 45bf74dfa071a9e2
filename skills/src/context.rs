//! What every skill node can reach: the robot, the plugins and the log of stages.

use crate::robot::Robot;
use serde::Serialize;
use sfg_plugin::{GraspPolicy, Grounder, LlmBackend, PoseGenerator};
use sfg_synergy::SynergySpace;
use sfg_tree::Failure;
use sfg_types::{
    AffordanceMask, FailureReason, FunctionalityAnswer, Instruction, Observation, PalmPoseCandidate, Point, Pose, Rejected,
    SceneInventory, Selection, StageRecord, TaskKeyPoint,
};
use sha2::{Digest as _, Sha256};
use std::sync::Arc;
use std::time::Instant;

/// The replaceable parts of a run.
pub struct Plugins {
    /// Language backend.
    pub llm: Box<dyn LlmBackend>,
    /// Scene inventory and part masks.
    pub grounder: Box<dyn Grounder>,
    /// Palm poses.
    pub pose_generator: Box<dyn PoseGenerator>,
    /// Closing.
    pub grasp_policy: Box<dyn GraspPolicy>,
}

/// The context of a tree of skills.
pub struct SkillContext {
    /// The robot, behind the engine's limits.
    pub robot: Robot,
    /// The plugins of the scenario.
    pub plugins: Plugins,
    /// What the user said.
    pub instruction: Instruction,
    /// The hand's synergy space.
    pub synergy: SynergySpace,
    /// Seed of the run.
    pub seed: u64,
    /// What was decided so far.
    pub log: StageLog,
    /// Latest artefacts, kept for pictures and viewers; no skill reads them.
    pub kept: Kept,
}

/// Artefacts worth showing.
#[derive(Clone, Debug, Default)]
pub struct Kept {
    /// First observation of the scene.
    pub observation: Option<Arc<Observation>>,
    /// What stands on the table.
    pub inventory: Option<Arc<SceneInventory>>,
    /// Part masks, one a view.
    pub masks: Option<Arc<Vec<AffordanceMask>>>,
    /// Key point.
    pub key_point: Option<Arc<TaskKeyPoint>>,
    /// Candidates as generated.
    pub candidates: Option<Arc<Vec<PalmPoseCandidate>>>,
    /// What was selected.
    pub selection: Option<Arc<Selection>>,
    /// Why candidates cannot be used, when none can.
    pub rejected: Option<Arc<Vec<Rejected>>>,
    /// The language backend's answer.
    pub answer: Option<FunctionalityAnswer>,
    /// Where the thing to hold was seen when it was last chosen.
    pub object_in_base: Option<Point>,
    /// Latest observation.
    pub last_observation: Option<Arc<Observation>>,
    /// Measured palm pose when the hand had closed.
    pub base_from_palm_at_grasp: Option<Pose>,
}

/// The stages that have ended.
#[derive(Debug)]
pub struct StageLog {
    records: Vec<StageRecord>,
    wall_secs: Vec<f64>,
    n_taken: usize,
    last: Instant,
}

impl Default for StageLog {
    fn default() -> Self {
        Self { records: Vec::new(), wall_secs: Vec::new(), n_taken: 0, last: Instant::now() }
    }
}

impl StageLog {
    /// All stages in the order in which they ended.
    #[must_use]
    pub fn records(&self) -> &[StageRecord] {
        &self.records
    }

    /// The stages that ended since the last call, each with the wall-clock time since the end of the one before it.
    pub fn take_new(&mut self) -> Vec<(StageRecord, f64)> {
        let begin = std::mem::replace(&mut self.n_taken, self.records.len());
        self.records[begin..].iter().cloned().zip(self.wall_secs[begin..].iter().copied()).collect()
    }

    fn push(&mut self, record: StageRecord) {
        self.records.push(record);
        let now = Instant::now();
        self.wall_secs.push((now - self.last).as_secs_f64());
        self.last = now;
    }
}

/// A failure of a skill: a reason from the closed list and one sentence.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SkillFailure {
    /// From the closed list.
    pub reason: FailureReason,
    /// What happened.
    pub explanation: String,
}

impl SkillFailure {
    /// A failure.
    pub fn new(reason: FailureReason, explanation: impl Into<String>) -> Self {
        Self { reason, explanation: explanation.into() }
    }

    /// A plugin's error as a failure of the skill that called it.
    #[must_use]
    pub fn plugin(error: &sfg_plugin::PluginError) -> Self {
        Self::new(FailureReason::PluginFailed, error.to_string())
    }
}

impl From<SkillFailure> for Failure {
    fn from(failure: SkillFailure) -> Self {
        Self::new(failure.reason.name(), failure.explanation)
    }
}

/// What a stage that ended well has to say.
#[derive(Clone, Debug)]
pub struct StageNote {
    /// One line for the user.
    pub summary: String,
    /// Hash of what was decided on.
    pub input_sha256: String,
    /// Everything else.
    pub details: serde_json::Value,
}

impl SkillContext {
    /// Enters the end of a stage into the log and passes its value on.
    ///
    /// # Errors
    /// The failure that `outcome` holds.
    pub fn finish_stage<T>(&mut self, stage: &str, outcome: Result<(T, StageNote), SkillFailure>) -> Result<T, Failure> {
        let stamp_secs = self.robot.now_secs();
        match outcome {
            Ok((value, note)) => {
                self.log.push(StageRecord {
                    stage: stage.to_owned(),
                    stamp_secs,
                    failure: None,
                    summary: note.summary,
                    input_sha256: note.input_sha256,
                    details: note.details,
                });
                Ok(value)
            }
            Err(failure) => Err(self.fail_stage(stage, failure)),
        }
    }

    /// Enters a failed stage into the log.
    pub fn fail_stage(&mut self, stage: &str, failure: SkillFailure) -> Failure {
        self.log.push(StageRecord {
            stage: stage.to_owned(),
            stamp_secs: self.robot.now_secs(),
            failure: Some(failure.reason),
            summary: failure.explanation.clone(),
            input_sha256: String::new(),
            details: serde_json::Value::Null,
        });
        failure.into()
    }
}

/// SHA-256 over anything that can be written as JSON, hexadecimal.
pub fn hash_of(value: &impl Serialize) -> String {
    hash_bytes(&serde_json::to_vec(value).unwrap_or_default())
}

/// SHA-256 over bytes, hexadecimal.
#[must_use]
pub fn hash_bytes(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect()
}
