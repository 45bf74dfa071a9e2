//! One trait a stage, in the order of the data path.

use serde::{Deserialize, Serialize};
use sfg_types::{
    AffordanceMask, FunctionalityAnswer, GraspType, HandFeedback, HandProfile, HandSide, Instruction, ObjectCluster, Observation,
    PalmPoseCandidate, Pose, RobotCommand, RobotState, SceneInventory, SynergyCoordinates, TaskKeyPoint, Tsdf,
};
use std::path::Path;

/// What a plugin gets when it is made.
#[derive(Clone, Copy, Debug)]
pub struct PluginContext<'a> {
    /// The parameters given in the scenario, an object (empty when none were given).
    pub params: &'a serde_json::Value,
    /// Folder of the scenario assets: robots, objects.
    pub scenarios_dir: &'a Path,
    /// The acting hand.
    pub hand: &'a HandProfile,
    /// Which one.
    pub hand_side: HandSide,
    /// Seed of the run; a plugin derives every random stream from it.
    pub seed: u64,
}

/// Why a plugin could not do its work. An expected negative result (nothing found) is not an error.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum PluginError {
    /// A parameter is unknown or out of range: the user mends the scenario.
    #[error("plugin {plugin:?}: {message}")]
    BadParameter {
        /// Name of the plugin.
        plugin: String,
        /// Which parameter, what was expected.
        message: String,
    },
    /// The work failed: the tree decides.
    #[error("plugin {plugin:?} failed: {message}")]
    Failed {
        /// Name of the plugin.
        plugin: String,
        /// Why.
        message: String,
    },
}

/// The question to a language backend.
#[derive(Clone, Copy, Debug)]
pub struct FunctionalityRequest<'a> {
    /// What the user said.
    pub instruction: &'a Instruction,
    /// What is on the table.
    pub inventory: &'a SceneInventory,
}

/// Infers how an object must be held for a task (paper, section IV-B).
pub trait LlmBackend: Send {
    /// The functionality asked for, a question back, or a refusal.
    ///
    /// # Errors
    /// [`PluginError::Failed`] when the backend cannot be reached or answers nonsense.
    fn infer(&mut self, request: &FunctionalityRequest<'_>) -> Result<FunctionalityAnswer, PluginError>;
}

/// A ball of the robot's own body, base frame, metres: points inside are the robot's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SelfSphere {
    /// Centre.
    pub centre_in_base: sfg_types::Point,
    /// Radius.
    pub radius_m: f64,
}

/// Which part of which thing to find.
#[derive(Clone, Copy, Debug)]
pub struct AffordanceQuery<'a> {
    /// The views to search.
    pub observation: &'a Observation,
    /// The thing.
    pub cluster: &'a ObjectCluster,
    /// Its category, for example `bottle`.
    pub object_name: &'a str,
    /// The part, for example `body` or `handle`.
    pub affordance: &'a str,
}

/// Finds things and their parts in the views (paper, section IV-C).
pub trait Grounder: Send {
    /// What stands on the table. An empty inventory is an ordinary result.
    ///
    /// # Errors
    /// [`PluginError::Failed`] when no view has usable depth.
    fn list_scene(&mut self, observation: &Observation, robot: &[SelfSphere]) -> Result<SceneInventory, PluginError>;

    /// Marks the part in every view: `out[i]` belongs to `observation.views[i]` and arrives empty. All masks empty = not found.
    ///
    /// # Errors
    /// [`PluginError::Failed`] when the views cannot be processed.
    fn ground(&mut self, query: &AffordanceQuery<'_>, out: &mut [AffordanceMask]) -> Result<(), PluginError>;
}

/// The question to a pose generator.
#[derive(Clone, Copy, Debug)]
pub struct PoseRequest<'a> {
    /// The object; its `base_from_grid` places it.
    pub tsdf: &'a Tsdf,
    /// `EDGE^3` voxels, 1 where the surface belongs to the part to hold.
    pub affordance_region: &'a [u8],
    /// Where the grasp should be near.
    pub key_point: &'a TaskKeyPoint,
    /// The hand.
    pub hand: &'a HandProfile,
    /// Which one; a left hand is a mirrored right one.
    pub hand_side: HandSide,
    /// The shape of the hand.
    pub grasp_type: GraspType,
    /// Height of the table above the base origin, metres.
    pub table_height_m: f64,
}

/// Proposes palm poses on an object (paper, section IV-D).
pub trait PoseGenerator: Send {
    /// Fills `out` with at most `out.len()` candidates, best first, and returns how many. Zero is an ordinary result.
    ///
    /// # Errors
    /// [`PluginError::Failed`] when the request cannot be processed.
    fn generate(&mut self, request: &PoseRequest<'_>, out: &mut [PalmPoseCandidate]) -> Result<usize, PluginError>;
}

/// How the hand is to close.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ClosingPlan {
    /// Shape of the hand when it arrives.
    pub preshape: SynergyCoordinates,
    /// `c_tar`.
    pub target: SynergyCoordinates,
    /// Shape of the hand asked for.
    pub grasp_type: GraspType,
    /// Palm pose reached.
    pub base_from_palm: Pose,
}

/// What a policy sees each control period.
#[derive(Clone, Copy, Debug)]
pub struct GraspPolicyState {
    /// Time since closing began.
    pub elapsed_secs: f64,
    /// Length of a control period.
    pub period_secs: f64,
    /// Set point of the period before.
    pub synergy: SynergyCoordinates,
    /// Measured palm pose.
    pub base_from_palm: Pose,
}

/// What a policy wants next.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PolicyStep {
    /// Next set point of the hand.
    pub synergy: SynergyCoordinates,
    /// Twist of the palm in the palm frame over this period: metres then radians.
    pub palm_correction: [f64; 6],
    /// The hand has closed.
    pub done: bool,
}

/// Closes the hand (paper, section IV-E).
pub trait GraspPolicy: Send {
    /// Begins a closing.
    ///
    /// # Errors
    /// [`PluginError::Failed`] when the plan cannot be followed.
    fn start(&mut self, plan: &ClosingPlan, hand: &HandProfile) -> Result<(), PluginError>;

    /// The next set point.
    ///
    /// # Errors
    /// [`PluginError::Failed`] when the policy cannot go on.
    fn step(&mut self, state: &GraspPolicyState, feedback: &HandFeedback) -> Result<PolicyStep, PluginError>;
}

/// Facts about a driver.
#[derive(Clone, Debug, PartialEq)]
pub struct DriverInfo {
    /// Name, for example `sim`.
    pub name: String,
    /// Length of a control period.
    pub period_secs: f64,
    /// The acting arm and hand.
    pub side: HandSide,
}

/// Moves a robot and reads its sensors.
///
/// The engine checks every command against the robot's limits before it comes here; a driver keeps its own as well.
pub trait Driver: Send {
    /// Facts that do not change.
    fn info(&self) -> DriverInfo;

    /// The newest image of every camera.
    ///
    /// # Errors
    /// [`PluginError::Failed`] when a camera is gone.
    fn observe(&mut self) -> Result<Observation, PluginError>;

    /// The newest measurement.
    ///
    /// # Errors
    /// [`PluginError::Failed`] when the robot is gone.
    fn state(&mut self) -> Result<RobotState, PluginError>;

    /// Sets the set point of the coming period.
    ///
    /// # Errors
    /// [`PluginError::Failed`] when it is refused.
    fn command(&mut self, command: &RobotCommand) -> Result<(), PluginError>;

    /// Lets one control period pass.
    ///
    /// # Errors
    /// [`PluginError::Failed`] when the robot is gone.
    fn advance(&mut self) -> Result<(), PluginError>;

    /// Brings the arm to rest at once and holds; works from any state and more than once.
    ///
    /// # Errors
    /// [`PluginError::Failed`] when the robot cannot be reached any more.
    fn stop(&mut self) -> Result<(), PluginError>;
}
